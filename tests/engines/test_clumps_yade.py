"""Clumps on fused against YADE's, at equal states."""

import numpy as np
import pytest

from labkit.bodies.shapes import Rod, Tetrapod
from labkit.engines import Device
from labkit.engines.fused import FusedEngine
from labkit.engines.yade import YadeEngine
from labkit.grains.scene import Scene
from labkit.micro.snapshot import love_stress
from labkit.paths.standard import ConstantVolume
from labkit.records.energy import balance_error, kinetic_energy, open_ledger
from labkit.simulation.api import run
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import prepare_specimen
from tests.engines.test_clumps import FREE, STILL, Lump, R, bodies

pytestmark = [pytest.mark.slow, pytest.mark.yade]


@pytest.mark.parametrize("shape", [Lump(), Tetrapod(), Rod(2.0, 2)], ids=lambda shape: shape.name)
def test_two_clumps_collide_as_in_yade(shape):
    """Frictional, far off centre; the rotations differ by the scheme, so the difference falls with the time step."""
    spin, velocity = [[100.0, 300.0, -200.0], [0, 0, 500.0]], np.array([[0.2, 0, 0], [-0.2, 0, 0]])
    places, far = [[2e-3] * 3, [2e-3 + 2.1 * R, 2e-3 + 0.6 * R, 2e-3 + 0.4 * R]], []
    for dt in (4e-8, 2e-8):
        start = open_ledger(bodies(FREE, places, shape, 4, body_velocity=velocity, spin=spin).replace(time_step=dt))
        ends = []
        for kind in (FusedEngine, YadeEngine):
            engine = kind(start)
            loaded = engine.state().clumps
            for name in ("body_position", "body_velocity", "orientation", "angular_momentum"):
                a, b = getattr(loaded, name), getattr(start.clumps, name)
                b = b * np.sign((a * b).sum(axis=1, keepdims=True)) if name == "orientation" else b
                assert a == pytest.approx(b, rel=1e-9, abs=1e-9 * np.abs(b).max()), name
            engine.advance(round(3e-4 / dt), STILL)
            ends.append(engine.state())
        a, b = (end.clumps for end in ends)
        assert abs(a.body_velocity - velocity).max() > 0.05
        assert kinetic_energy(ends[0]) == pytest.approx(kinetic_energy(ends[1]), rel=1e-2)
        far.append(np.abs(a.body_velocity - b.body_velocity).max() / 0.2)
    assert far[0] < 2e-2 and far[1] < 0.7 * far[0] + 1e-6


def test_a_small_specimen_is_sheared_as_in_yade():
    recipe = Recipe(0.48, 0.15, 0.0, grains=250, shape="rod aspect_ratio=1.5")
    rods = prepare_specimen(Scene(friction=0.5, rolling_friction=0.0), recipe, Device("fused"))
    yade = YadeEngine(open_ledger(rods))
    assert yade.stress() == pytest.approx(love_stress(rods.snapshot()), rel=1e-9, abs=1.0)
    path = ConstantVolume(strain=0.003, rate=40.0)
    runs = [run(rods, path, engine=engine, progress=False) for engine in ("fused", "yade")]
    stress = [one.data["stress"].values for one in runs]
    assert stress[1] == pytest.approx(stress[0], abs=0.03 * stress[0][-1, 2, 2])
    end = runs[1].state
    assert abs(stress[0][-1] - stress[0][0]).max() > 0.05 * stress[0][-1, 2, 2]
    assert abs(balance_error(end)) < 5e-3
    assert love_stress(end.snapshot()) == pytest.approx(stress[1][-1], rel=1e-9)
    resumed = YadeEngine(end).state()
    assert resumed.clumps.angular_momentum == pytest.approx(end.clumps.angular_momentum, rel=1e-12)

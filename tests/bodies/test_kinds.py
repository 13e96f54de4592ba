"""Another kind of bodies is one class: its variables reach files, runs and checkpoints, its statistic a snapshot."""

import dataclasses

import numpy as np
import pytest

import labkit as lk
from labkit.bodies.clumps import Clumps
from labkit.bodies.kinds import constant, declare
from labkit.bodies.shapes import Rod
from labkit.engines import Device
from labkit.errors import InputError
from labkit.files.schema import BODIES
from labkit.micro.bodies import anisotropy_of
from labkit.results.info import describe_file
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import insert_grains, relax
from tests.bodies.clumped import clumped


@pytest.fixture(scope="module")
def kind():
    """Clumps with the flattening of an ellipsoid of equal inertia and a crack, a plane fixed in the body."""

    @declare
    @dataclasses.dataclass(frozen=True, eq=False)
    class Cracked(Clumps):
        flattening: np.ndarray = constant("clump", "1", "shortest over longest axis")
        crack: np.ndarray = constant("clump i", "1", "normal of the crack in the principal axes of the body")

        def crack_anisotropy(self):
            return anisotropy_of(np.einsum("bij,bj->bi", self.axes(), self.crack))

    yield Cracked
    del BODIES["flattening"]


@pytest.fixture(scope="module")
def start(kind):
    scene = lk.Scene(friction=0.5, rolling_friction=0.0)
    inserted = insert_grains(scene, Recipe(0.5, grains=120))
    state = clumped(inserted, [Rod(1.5)], 2)
    bodies = len(inserted.radius)
    normal = np.random.default_rng(3).normal(size=(bodies, 3))
    own = {"flattening": np.linspace(0.5, 1.0, bodies), "crack": normal / np.linalg.norm(normal, axis=1)[:, None]}
    return state.replace(clumps=kind(**state.clumps.arrays, **own))


def test_its_variables_survive_a_state_file(kind, start, tmp_path):
    file = tmp_path / "s.state.nc"
    lk.write_state(file, start)
    again = lk.read_state(file)
    assert type(again.clumps) is kind and again.digest() == start.digest()
    assert all(np.array_equal(again.arrays[name], values) for name, values in start.arrays.items())
    assert "other variables" not in describe_file(file)
    lk.write_state(tmp_path / "c.state.nc", start.replace(clumps=Clumps(*list(start.clumps.arrays.values())[:8])))
    assert type(lk.read_state(tmp_path / "c.state.nc").clumps) is Clumps


def test_a_file_that_lacks_one_is_refused(kind, start, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(kind, "table", {name: row for name, row in kind.table.items() if name != "crack"})
        lk.write_state(tmp_path / "s.state.nc", start)
    with pytest.raises(InputError, match="crack is missing"):
        lk.read_state(tmp_path / "s.state.nc")


@pytest.mark.slow
def test_a_run_keeps_them_and_they_turn_with_the_bodies(kind, start, tmp_path):
    file = tmp_path / "r.run.nc"
    path = lk.paths.ConstantVolume(strain=0.002, rate=40.0)
    run = lk.run(relax(start, start.scene, Device("fused")), path, file=file, progress=False)
    end, at = lk.read_state(file), run.snapshots[-1]
    for bodies in (end.clumps, at.clumps, lk.open_run(file).lab.snapshot(-1).clumps):
        assert type(bodies) is kind
        assert np.array_equal(bodies.crack, start.clumps.crack)
        assert np.array_equal(bodies.flattening, start.clumps.flattening)
    assert not np.array_equal(end.clumps.orientation, start.clumps.orientation)
    turned = np.einsum("bij,bj->bi", end.clumps.axes(), start.clumps.crack)
    assert at.clumps.crack_anisotropy() == pytest.approx(anisotropy_of(turned))


def test_a_kind_without_variables_of_its_own_is_refused():
    with pytest.raises(ValueError, match="Same has no variable of its own"):
        declare(type("Same", (Clumps,), {}))

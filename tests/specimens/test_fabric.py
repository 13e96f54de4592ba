"""Specimens with a fabric: its sign, at an isotropic stress, and at a void ratio."""

import dataclasses
import json

import numpy as np
import pytest

import labkit as lk
from labkit.cli.dispatch import main
from labkit.errors import InputError
from labkit.micro.stress import largest_deviation
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.specimens.bisection import share_by_line
from labkit.specimens.recipe import FABRICS, Recipe

PRESSURE = 200e3
SIGNS = {"deposited": 1, "pre-compressed": 1, "pre-extended": -1}
LEAST = 0.06  # |A_zz|; deposited: 0.04 to 0.16 in five specimens of 200 grains, 0.08 to 0.17 in four of 1,000
DENSE = Recipe(preparation="compression", pressure=PRESSURE, grains=200, step1_friction=0.15)


def axial_anisotropy(state):
    return float(lk.statistics(state.snapshot()).contact_anisotropy[2, 2])


def made(fabric, engine="fused", **changes):
    return lk.make_specimen(dataclasses.replace(DENSE, fabric=fabric, **changes), engine=engine, progress=False)


@pytest.mark.parametrize("engine, fabric", [*(("fused", fabric) for fabric in SIGNS), ("yade", "deposited")])
def test_a_fabric_has_its_sign_at_an_isotropic_stress(engine, fabric):
    state = made(fabric, engine, grains=1000 if engine == "fused" else 100)
    assert SIGNS[fabric] * axial_anisotropy(state) > LEAST
    assert largest_deviation(lk.love_stress(state.snapshot()), PRESSURE)[1] < 1.5e-3 * PRESSURE
    assert json.loads(state.recipe)["fabric"] == fabric
    assert (state.velocity == 0.0).all()


def test_clumps_and_fixed_cells_have_a_fabric_too():
    rods = made("deposited", shape="rod aspect_ratio=1.5")
    assert axial_anisotropy(rods) > LEAST
    fixed = made("pre-extended", cell="fixed")
    assert axial_anisotropy(fixed) < -LEAST
    np.testing.assert_allclose(np.diag(lk.love_stress(fixed.snapshot())), PRESSURE, rtol=1.5e-3)


def test_bisection_reaches_the_void_ratio_with_the_fabric():
    recipe = Recipe(0.74, preparation="bisection", pressure=PRESSURE, grains=200, tolerance=0.01, fabric="pre-extended")
    state = lk.make_specimen(recipe, progress=False)
    assert void_ratio_nominal(state.snapshot()) == pytest.approx(0.74, abs=0.01)
    assert axial_anisotropy(state) < -LEAST
    assert Recipe.from_json(state.recipe) == recipe


def test_a_search_among_scattering_trials_goes_on_with_new_shares_between_the_nearest():
    rng = np.random.default_rng(7)
    for scatter in (0.0, 0.004, 0.1):
        shares = sorted(rng.uniform(0.05, 0.9, 6))
        trials = [(share, 0.5 + 0.4 * share + rng.normal(0.0, scatter)) for share in shares]
        for _ in range(14):
            share = share_by_line(trials, 0.7)
            near = sorted(trials, key=lambda trial: abs(trial[1] - 0.7))[:5]
            assert min(near)[0] <= share <= max(near)[0] and share not in [before for before, _ in trials]
            trials.append((share, 0.5 + 0.4 * share + rng.normal(0.0, scatter)))
            if abs(trials[-1][1] - 0.7) < 0.002:
                break
        reached = [abs(e - 0.7) for _, e in trials]
        assert min(reached) < max(0.002, 0.5 * scatter)
    assert share_by_line([(0.1, 0.6), (0.3, 0.8), (0.2, 0.7)], 0.7) not in (0.1, 0.2, 0.3)


def test_the_sign_of_the_fabric_decides_what_a_test_at_constant_volume_does():
    least = {}
    for fabric in ("pre-compressed", "pre-extended"):
        state = made(fabric)
        for strain in (0.01, -0.01):
            p = lk.run(state, lk.paths.ConstantVolume(strain=strain, rate=40), progress=False).data.lab.mean_stress()
            least[fabric, strain > 0] = float(p.min() / p[0])
    assert least["pre-compressed", True] > least["pre-extended", True] + 0.2
    assert least["pre-extended", False] > least["pre-compressed", False] + 0.2


@pytest.mark.parametrize("fabric", SIGNS)
@pytest.mark.parametrize("preparation", ["insertion", "compression"])
def test_a_fabric_without_a_pressure_is_refused(fabric, preparation):
    with pytest.raises(InputError, match=f"fabric '?{fabric}'? needs a pressure: give a pressure with preparation"):
        Recipe(0.7, preparation=preparation, fabric=fabric)


def test_an_unknown_fabric_and_an_older_recipe():
    with pytest.raises(InputError, match=f"fabric 'deposit' is unknown: .* of {', '.join(FABRICS)}"):
        dataclasses.replace(DENSE, fabric="deposit")
    older = json.loads(DENSE.to_json())
    del older["fabric"]
    assert Recipe.from_json(json.dumps(older)) == DENSE


def test_command_line_and_info_say_the_fabric(tmp_path, capsys):
    file = str(tmp_path / "s.state.nc")
    command = f"specimen --preparation compression --pressure 200kPa --grains 200 --fabric deposited -o {file}"
    assert main(command.split()) == 0
    capsys.readouterr()
    assert main(["info", file]) == 0
    shown = capsys.readouterr().out
    (line,) = (line for line in shown.splitlines() if "contact anisotropy A_zz" in line)
    assert float(line.split()[-1]) == pytest.approx(axial_anisotropy(lk.read_state(file)), abs=1e-3)

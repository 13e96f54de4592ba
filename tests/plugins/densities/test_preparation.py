"""Specimens compressed from a gas, their density limits."""

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.micro.fabric import statistics
from labkit.micro.snapshot import love_stress
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.plugins.densities import preparation
from labkit.plugins.densities.preparation import DensityLimits, specimen_at
from labkit.simulation.api import make_specimen
from labkit.specimens.recipe import Recipe

pytestmark = pytest.mark.slow


def compressed(friction, **changes):
    values = {"grains": 200, "preparation": "compression", "pressure": "300 kPa", **changes}
    return make_specimen(
        Recipe(step1_friction=friction, step1_rolling_friction=friction, **values), Scene(), progress=False
    )


@pytest.fixture(scope="module")
def lubricated():
    return compressed(0.0)


def test_friction_during_compression_decides_density_and_coordination(lubricated):
    loose = compressed(0.4)
    dense, loose = lubricated.snapshot(), loose.snapshot()
    for snapshot in (dense, loose):
        np.testing.assert_allclose(np.diag(love_stress(snapshot)), 300e3, rtol=2e-3)
    limits = DensityLimits(*(np.array([void_ratio_nominal(s)]) for s in (dense, loose)), 300e3)
    assert limits.e_max - limits.e_min > 0.1
    assert statistics(dense).coordination_number > 6.0 > statistics(loose).coordination_number + 1.0
    assert np.isclose(limits.relative_density(limits.void_ratio(0.3)), 0.3)


def test_intervals_of_relative_densities_follow_from_the_scatter_of_the_limits():
    """Student's t: 4.303 for three specimens; the standard errors of e_min and e_max are 0.001 and 0.002."""
    step = np.array([-1.0, 0.0, 1.0]) * np.sqrt(3.0)
    limits = DensityLimits(0.6 + 0.001 * step, 0.8 + 0.002 * step, 100e3)
    table = limits.table({"mine": 0.75}).set_index("name")
    assert table.loc["e_max", "+-"] == pytest.approx(4.303 * 0.002, rel=1e-3)
    assert table["relative_density"].to_dict() == pytest.approx({"e_min": 1.0, "e_max": 0.0, "mine": 0.25})
    expected = 4.303 * np.hypot(0.75 * 0.002, 0.25 * 0.001) / 0.2
    assert table.loc["mine", "relative_density +-"] == pytest.approx(expected, rel=1e-3)
    assert limits.void_ratio("60 %") == limits.void_ratio(0.6) == pytest.approx(0.68)
    with pytest.raises(lk.InputError, match=r"relative_density 60 is not valid: give -0\.5 to 1\.5"):
        limits.void_ratio(60)
    with pytest.raises(lk.InputError, match="void_ratio 65 is not valid: give 0 to 3"):
        limits.relative_density(65)


def test_a_specimen_that_fails_is_left_out_of_the_limits_with_its_reason(monkeypatch):
    def failing(recipe, *arguments, **named):
        if recipe.seed == 2:
            raise lk.PhysicsError("it did not come to rest")
        return lk.make_specimen(recipe, *arguments, **named)

    monkeypatch.setattr(preparation, "make_specimen", failing)
    limits = preparation.density_limits(lk.Scene(), grains=100, seeds=(1, 2))
    assert len(limits.e_min) == len(limits.e_max) == 1 and limits.e_min[0] < limits.e_max[0]
    assert limits.left_out == tuple(
        f"{name}, seed 2 is left out: it did not come to rest" for name in ("e_min", "e_max")
    )
    with pytest.raises(lk.PhysicsError, match="e_min, seed 2 is left out"):
        preparation.density_limits(lk.Scene(), grains=100, seeds=[2])


def test_a_specimen_of_a_given_void_ratio_is_found():
    state = specimen_at(Scene(), 0.7, pressure=300e3, grains=200)
    assert np.isclose(void_ratio_nominal(state.snapshot()), 0.7, atol=0.002)
    np.testing.assert_allclose(np.diag(love_stress(state.snapshot())), 300e3, rtol=2e-3)


def test_the_densest_specimen_can_be_asked_for_and_a_denser_one_is_refused_soon(lubricated):
    densest, texts = void_ratio_nominal(lubricated.snapshot()), []
    state = specimen_at(Scene(), densest, pressure=300e3, grains=200, progress=False)
    np.testing.assert_array_equal(state.position, lubricated.position)
    note = lambda fraction, text: texts.append(text)  # noqa: E731
    with pytest.raises(lk.PhysicsError, match=rf"the last gave {densest:.4f}"):
        specimen_at(Scene(), densest - 0.05, pressure=300e3, grains=200, progress=note)
    assert {text for text in texts if "of the friction" in text} == {
        next(text for text in texts if text.startswith(f"{share:.1%} of the friction")) for share in (0.3, 0.15)
    }


def test_the_command_and_a_recipe_make_the_same_specimen_at_a_void_ratio_and_a_pressure(labkit_command, tmp_path):
    recipe = Recipe(0.7, preparation="bisection", pressure="300 kPa", grains=200, tolerance=0.005)
    state = lk.make_specimen(recipe, progress=False)
    assert np.isclose(void_ratio_nominal(state.snapshot()), 0.7, atol=0.005)
    np.testing.assert_allclose(np.diag(love_stress(state.snapshot())), 300e3, rtol=2e-3)
    words = ["--void-ratio", 0.7, "--pressure", "300kPa", "--preparation", "bisection", "--grains", 200]
    again = ["specimen", *words, "--tolerance", 0.005, "-o", "s.state.nc"]
    assert labkit_command(*again, cwd=tmp_path).returncode == 0
    same = lk.read_state(tmp_path / "s.state.nc")
    np.testing.assert_array_equal(same.position, state.position)
    assert Recipe.from_json(same.recipe) == recipe
    assert "already holds this specimen" in labkit_command(*again, cwd=tmp_path).stdout


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"preparation": "bisection"}, "pressure is missing"),
        ({"preparation": "bisection", "pressure": "300 kPa", "step1_friction": 0.3}, "leave it out"),
        ({"tolerance": 0.01}, "preparation = bisection"),
        ({"pressure": "300 kPa"}, "preparation = bisection"),
    ],
)
def test_a_bisection_has_a_pressure_and_no_friction_of_its_own(values, words):
    with pytest.raises(InputError, match=words):
        Recipe(0.67, **values)


def test_one_seed_and_progress_as_for_a_specimen(capfd):
    one = lk.density_limits(Scene(), grains=100, seeds=1, pressure="100 kPa", progress=False)
    assert len(one.e_min) == 1 and one.pressure == 100e3 and capfd.readouterr().err == ""
    texts = []
    lk.density_limits(Scene(), grains=100, seeds=1, progress=lambda fraction, text: texts.append(text))
    assert texts == ["e_min, seed 1", "e_max, seed 1"]


def test_a_gas_is_compressed_to_a_void_ratio_in_a_tall_cell():
    state = compressed(0.1, void_ratio=0.6, pressure=None, aspect=3.0)
    assert np.isclose(void_ratio_nominal(state.snapshot()), 0.6, rtol=1e-6)
    assert np.isclose(state.cell[2, 2] / state.cell[0, 0], 3.0, rtol=2e-2)  # the free cell changes its shape
    kept = compressed(0.1, void_ratio=0.6, pressure=None, aspect=3.0, cell="fixed")
    assert np.isclose(kept.cell[2, 2] / kept.cell[0, 0], 3.0, rtol=1e-9)
    assert statistics(state.snapshot()).coordination_number > 4.0


def test_limits_need_friction_and_take_any_integers_as_seeds():
    with pytest.raises(lk.PhysicsError, match="give the material friction"):
        lk.density_limits(lk.Scene(friction=0.0, rolling_friction=0.0), grains=100, seeds=np.int64(1))
    limits = lk.density_limits(lk.Scene(), grains=100, seeds=iter([1, 2]))
    assert limits.e_min.shape == limits.e_max.shape == (2,)


def test_a_pressure_needs_the_preparation_by_compression():
    with pytest.raises(InputError, match="preparation = compression"):
        Recipe(0.67, pressure="300 kPa")


def test_a_compression_to_a_pressure_asks_for_no_void_ratio_and_claims_none(tmp_path, capsys):
    file = tmp_path / "s.state.nc"
    words = ["--preparation", "compression", "--pressure", "200kPa", "--grains", "150", "--engine", "fused"]
    assert main(["specimen", *words, "-o", str(file)]) == 0
    recipe = lk.Recipe(preparation="compression", pressure="200 kPa", grains=150)
    assert recipe.void_ratio is None and lk.Recipe.from_json(lk.read_state(file).recipe) == recipe
    capsys.readouterr()
    assert main(["info", str(file)]) == 0
    assert "    void_ratio             not given" in capsys.readouterr().out
    with pytest.raises(lk.InputError, match=r"^void_ratio is missing: give one, e\.g\. 0\.67$"):
        lk.Recipe(grains=150)
    with pytest.raises(lk.InputError, match=r"^void_ratio is missing"):
        lk.Recipe(grains=150, preparation="compression")

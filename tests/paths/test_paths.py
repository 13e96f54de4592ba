import dataclasses

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.paths.registry import PATHS, make_path, path_of
from labkit.paths.standard import Consolidation
from labkit.paths.step import Here
from labkit.records.limits import pressure_limit, require_pressure
from labkit.servo.plan import prescribed_gradient


def test_cv_keeps_the_volume_over_a_whole_test_to_rounding():
    """The cell moves as in an engine, H += dt L H, in 300,000 steps to 40 % strain."""
    dt = 1.2e-7
    path = make_path("cv", {"rate": 10.0, "strain": 0.4})
    increment = dt * np.diag(prescribed_gradient(path, dt))
    cell = np.full(3, 4e-3)
    volume = cell.prod()
    for _ in range(300_000):
        cell += increment * cell
    assert abs(cell.prod() / volume - 1) < 1e-10
    assert np.isclose(-np.log(cell[2] / 4e-3), 10.0 * dt * 300_000, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "parameters", "field"),
    [
        ("cx", {}, "path"),
        ("cv", {"strain": 0.0}, "strain"),
        ("oedometer", {"strain": -0.1}, "strain"),
        ("cyclic_cp", {"pressure": 1e5, "strain": 0.1}, "strain"),
        ("cyclic_cp", {"pressure": 1e5, "reversals": (0.01, 0.01)}, "reversals"),
        ("cv", {"pressure": 1e5}, "pressure"),
        ("cr", {"reversals": (0.1,)}, "reversals"),
    ],
)
def test_impossible_paths_are_refused(name, parameters, field):
    with pytest.raises(InputError) as refused:
        make_path(name, parameters)
    assert refused.value.field == field


@pytest.mark.parametrize(("name", "pressure"), [("cr", 4e6), ("isoc", 3.1e6), ("isoc", 3.0001e6)])
def test_a_pressure_at_which_grains_overlap_too_much_is_refused(name, pressure):
    """The limit is 0.02 E: 3 MPa for the grains of Table 1, in proportion to E for others."""
    path = make_path(name, {"pressure": pressure})
    said = r"Pa is too high for grains with E = 1\.5e\+08 Pa: give at most 3e\+06 Pa, where the mean overlap .* 2 %, "
    said += r"or use grains with E of at least [\d.]+e\+08 Pa"
    with pytest.raises(InputError, match=said) as refused:
        require_pressure(path, Scene())
    assert (refused.value.field, refused.value.value) == ("pressure", pressure)
    require_pressure(path, Scene(young_modulus=float(str(refused.value).split()[-2]) * (1.0 + 1e-5)))
    require_pressure(make_path(name, {"pressure": 3e6}), Scene())
    assert pressure_limit(Scene()) == 3e6 and pressure_limit(Scene(young_modulus=70e9)) == 1.4e9
    with pytest.raises(InputError):
        require_pressure(make_path(name, {"pressure": 3e6}), Scene(young_modulus=0.1e9))


@pytest.mark.parametrize("name", ["cr", "cp", "cyclic_cp"])
def test_a_path_that_holds_a_stress_needs_its_value(name):
    """Without a pressure the path uses that of its specimen; until it has the specimen, it has no Control."""
    with pytest.raises(InputError, match="pressure") as refused:
        make_path(name).control()
    assert refused.value.field == "pressure"
    assert make_path(name).starting_at(2e5).control().target[0] == 2e5
    assert make_path(name, {"pressure": 1e5}).starting_at(2e5).pressure == 1e5


@pytest.mark.parametrize("pressure", [50.0, 1e-3])
def test_a_small_pressure_given_with_its_unit_is_held(pressure):
    """A bare number below 100 Pa is refused; a value given with its unit must not be refused later."""
    path = make_path("cp", {"pressure": f"{pressure!r} Pa"})
    assert path.pressure == pressure
    assert path_of("cp", dataclasses.asdict(path)) == path
    assert make_path("cp").starting_at(pressure) == path
    assert Consolidation(pressure=f"{pressure!r} Pa").control().target[0] == pressure


def test_every_path_of_the_paper_is_registered():
    assert list(PATHS)[:6] == ["cv", "cr", "cp", "isoc", "isod", "cyclic_cp"]
    turns = [step.until.turn for step in make_path("cyclic_cp", {"pressure": 0.5e6}).steps_from(Here())]
    assert turns == [0.01, -0.01, 0.02, -0.02, 0.03, -0.03, 0.04]
    assert make_path("cr").starting_at(2e5).pressure == 2e5
    (isoc,), (isod,) = (make_path(name).steps_from(Here()) for name in ("isoc", "isod"))
    assert isoc.ends_at(3e6 * np.eye(3)) and not isoc.ends_at(2.9e6 * np.eye(3))
    assert isod.ends_at(19e3 * np.eye(3)) and not isod.ends_at(21e3 * np.eye(3))

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.dem.paths import PATHS, make_path
from labkit.dem.servo import velocity_gradient


def test_cv_keeps_the_volume_over_a_whole_test_to_rounding():
    """300,000 steps to 40 % strain, as an engine moves the cell: H += dt L H."""
    dt = 1.2e-7
    path = make_path("cv", rate=10.0, strain=0.4)
    increment = dt * np.diag(velocity_gradient(path, 1.0, dt))
    cell = np.full(3, 4e-3)
    volume = cell.prod()
    for _ in range(300_000):
        cell += increment * cell
    assert abs(cell.prod() / volume - 1) < 1e-10
    assert np.isclose(-np.log(cell[2] / 4e-3), 10.0 * dt * 300_000, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("cx", {}), ("cv", {"strain": 0.0}), ("cv", {"strain": -0.1}), ("cv", {"strain": float("nan")}),
     ("cv", {"rate": 0.0}), ("cv", {"rate": -10.0}), ("cv", {"strain": 5.0}), ("cr", {}), ("cr", {"pressure": 4e6}),
     ("cp", {"pressure": 0.0}), ("cp", {"pressure": -1e5}), ("isoc", {"pressure": 3.1e6}), ("isod", {"strain": 0.1}),
     ("isoc", {"strain": -0.1}), ("cyclic_cp", {"pressure": 1e5, "reversals": ()}),
     ("cyclic_cp", {"pressure": 1e5, "reversals": (0.01, 0.02)}), ("cyclic_cp", {"pressure": 1e5, "strain": 0.1}),
     ("cyclic_cp", {"pressure": 1e5, "reversals": (0.01, 0.01)}), ("cv", {"pressure": 1e5}),
     ("cyclic_cp", {"pressure": 1e5, "reversals": (0.01, float("nan"))}), ("cr", {"reversals": (0.1,)})],
)  # fmt: skip
def test_impossible_paths_are_refused(name, parameters):
    with pytest.raises(InputError):
        make_path(name, **parameters)


def test_every_path_of_the_paper_is_there_under_its_name():
    assert list(PATHS) == ["cv", "cr", "cp", "isoc", "isod", "cyclic_cp"]
    assert make_path("cyclic_cp", pressure=0.5e6).turning_points() == (0.01, -0.01, 0.02, -0.02, 0.03, -0.03, 0.04)
    assert make_path("cr", pressure_now=2e5).pressure == 2e5
    assert make_path("isoc").stops(3e6) and not make_path("isoc").stops(2.9e6)
    assert make_path("isod").stops(19e3) and not make_path("isod").stops(21e3)

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.paths import make_path, velocity_gradient


def test_cv_keeps_the_volume_over_a_whole_test_to_rounding():
    """300,000 steps to 40 % strain, as an engine moves the cell: H += dt L H."""
    dt = 1.2e-7
    path = make_path("cv", rate=10.0, strain=0.4)
    increment = dt * np.diag(velocity_gradient(path.strain_rate(), dt))
    cell = np.full(3, 4e-3)
    volume = cell.prod()
    for _ in range(300_000):
        cell += increment * cell
    assert abs(cell.prod() / volume - 1) < 1e-10
    assert np.isclose(-np.log(cell[2] / 4e-3), 10.0 * dt * 300_000, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("cx", {}), ("cv", {"strain": 0.0}), ("cv", {"strain": -0.1}), ("cv", {"strain": float("nan")}),
     ("cv", {"rate": 0.0}), ("cv", {"rate": -10.0}), ("cv", {"strain": 5.0})],
)  # fmt: skip
def test_impossible_paths_are_refused(name, parameters):
    with pytest.raises(InputError):
        make_path(name, **parameters)

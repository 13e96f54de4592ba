"""Tractions on plane cuts of real specimens, in a box and in a sheared cell."""

import numpy as np
import pytest

import labkit
from labkit.errors import InputError
from labkit.micro.planes import plane_normal, plane_tractions
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import mean_stress


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["run_file", "shear_file"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_traction_on_every_plane_is_that_of_loves_stress(kind, axis, request):
    """Layers between two planes are in equilibrium, apart from inertia."""
    snapshot = labkit.open_run(request.getfixturevalue(kind)).lab.snapshot(-1)
    love = love_stress(snapshot)
    difference = plane_tractions(snapshot, axis, 200) - plane_normal(snapshot, axis) @ love
    assert np.abs(difference).max() < 0.01 * mean_stress(love)
    assert np.abs(difference.mean(axis=0)).max() < 1e-3 * mean_stress(love)


def test_a_plane_that_is_not_there_is_refused(run_file):
    snapshot = labkit.open_run(run_file).lab.snapshot(-1)
    with pytest.raises(InputError, match="0, 1 or 2"):
        plane_tractions(snapshot, 3, 10)
    with pytest.raises(InputError, match="1 or more"):
        plane_tractions(snapshot, 2, 0)

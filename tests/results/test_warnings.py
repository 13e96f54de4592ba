"""Warnings point at the user's line, also if labkit's functions call each other."""

import warnings

import pytest

import labkit as lk
from labkit.errors import LabkitWarning

SMALL = lk.Recipe(void_ratio=0.66, grains=100)


@pytest.mark.slow
@pytest.mark.parametrize(
    "call",
    [
        lambda state: lk.make_specimen(SMALL, progress=False),
        lambda state: lk.density_limits(lk.Scene(), grains=100, seeds=[1], progress=False),
        lambda state: lk.run(state, lk.paths.ConstantVolume(strain=0.002, rate=80.0), progress=False),
        lambda state: lk.run_many([(state, lk.paths.ConstantVolume(strain=0.002, rate=80.0))], progress=False),
    ],
    ids=["make_specimen", "density_limits", "run", "run_many"],
)
def test_a_warning_points_at_the_line_of_the_user(soft_specimen, call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", LabkitWarning)
        call(soft_specimen)
    mine = [each.filename for each in caught if each.category is LabkitWarning]
    assert mine and set(mine) == {__file__}

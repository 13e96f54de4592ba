"""Lode angles from the same cubes, and dense against loose: planted differences are found, and none is invented."""

import numpy as np
import pandas
import pytest

from analysis.dense_against_loose.study import DENSITIES, PRESSURES, SECOND, differences
from analysis.lode_angle.study import ASKED, comparisons


@pytest.mark.parametrize("bent", [0.0, 0.05])
def test_the_ends_and_the_middle_of_the_lode_angle_are_compared_by_cube(bent):
    rng, rows = np.random.default_rng(7), []
    for cube in range(4):
        own = rng.normal(0.0, 0.1)
        for test, b in (("b000", 0.0), ("b050", 0.5), ("b100", 1.0)):
            value = 1.0 + own - 0.2 * b - bent * (b == 0.5)
            rows.append({"test": test, "specimen": cube} | {name: value + rng.normal(0.0, 0.003) for name in ASKED})
    found = comparisons(pandas.DataFrame(rows)).set_index(["comparison", "quantity"])
    for name in ASKED:
        for comparison, true in ((1, -0.2), (2, -bent)):
            row = found.loc[comparison, name]
            assert abs(row["difference"] - true) < 2.0 * row["within"] < 0.03 and row["specimens"] == 4
            assert (row["corrected"] < 0.05) == (true != 0.0)


@pytest.mark.parametrize("offset", [0.0, 0.02])
def test_the_density_of_a_specimen_is_found_in_its_end_only_if_planted(offset):
    rng, rows = np.random.default_rng(8), []
    for test in PRESSURES:
        for density in DENSITIES:
            for _ in range(19):
                e = 0.7 + offset * (density == "dense") + rng.normal(0.0, 0.0025)
                others = {name: 1.0 + rng.normal(0.0, 0.01) for name in SECOND}
                rows.append({"test": test, "density": density, "e": e} | others)
    found = differences(pandas.DataFrame(rows))
    asked = found[found["comparison"] == 1]
    assert (abs(asked["difference"] - offset) < asked["within"] * 1.5).all() and (asked["specimens"] == 38).all()
    assert (asked["corrected"] < 0.05).tolist() == [offset > 0.0] * 2
    assert asked["equivalent"].tolist() == [offset == 0.0] * 2
    assert len(found) == 2 + 2 * len(SECOND) and found.loc[found["comparison"] == 2, "corrected"].min() > 0.05

"""Initial fabric: the force that balances it, and planted twins."""

import numpy as np
import pandas
import pytest

from analysis.initial_fabric.loading import STRAIN, specimen_of
from analysis.initial_fabric.response import (
    BEFORE,
    MEASURES,
    coordination_table,
    direction_table,
    measures_of,
    twin_table,
)
from analysis.initial_fabric.states import axis_of, balancing_force
from labkit.micro import equivalent_stress, mean_stress
from labkit.sff import c0_stress

pytestmark = pytest.mark.long


def test_the_balancing_force_makes_the_stress_of_c0_isotropic():
    n = axis_of(45.0)
    A = 0.2 * (1.5 * np.outer(n, n) - 0.5 * np.eye(3))
    Ft = -0.015 * (1.5 * np.outer(n, n) - 0.5 * np.eye(3))

    def ratio(F, Ft):
        stress = c0_stress(1.5e8, 4.7, 0.004, 0.73, A, F, Ft)
        return float(equivalent_stress(stress) / mean_stress(stress))

    assert ratio(balancing_force(A, Ft), Ft) < 0.01 < 0.05 < ratio(balancing_force(A, np.zeros((3, 3))), Ft)
    # the F^0 of section 5.3 along the axis, -0.2 / (1 + 4/7 0.2), without its trace
    assert n @ balancing_force(A, 0.0 * Ft) @ n == pytest.approx(-0.1904, abs=1e-4)


def test_measures_of_known_curves():
    curves = {"ratio": np.minimum(20 * STRAIN, 0.8), "volumetric": 0.1 * STRAIN, "Z": 5.0 - STRAIN}
    found = measures_of(curves)
    assert found["q/p at 0.5 %"] == pytest.approx(0.1) and found["largest q/p"] == pytest.approx(0.8)
    assert found["volumetric strain at 15 % (%)"] == pytest.approx(1.5) and found["Z at 2 %"] == pytest.approx(4.98)
    assert specimen_of("sheared45-loose_500-s1") == "loose-s1"


def planted():
    """Responses in which the direction (0 minus 90 degrees) changes q/p at 0.5 % by -0.1, and Z0 changes it by 0.2."""
    rng = np.random.default_rng(1)
    rows = []
    tests = [(test, "loose", seed) for test in ("sheared00", "sheared45", "sheared90", "none") for seed in range(4)]
    tests += [("none", group, seed) for group in ("high_loose", "high_medium", "medium") for seed in range(4)]
    for test, group, seed in tests:
        values = {name: 1.0 + rng.normal(0.0, 0.01) for name in (*BEFORE, *MEASURES)}
        values["Z0"] += "high" in group
        values["e0"] += "loose" in group
        angle = {"sheared45": 0.05, "sheared90": 0.1}.get(test, 0.0)
        values["q/p at 0.5 %"] += angle + 0.2 * ("high" in group) + 0.3 * ("loose" in group)
        rows.append({"test": test, "group": group, "specimen": f"{group}-s{seed}", "source": "grains", **values})
    return pandas.DataFrame(rows)


def test_planted_effects_are_found_and_no_others():
    for table, effect in ((direction_table(planted()), -0.1), (coordination_table(planted()), 0.2)):
        found = table[table["corrected"] <= 0.05]
        assert found["measure"].tolist() == ["q/p at 0.5 %"]
        assert abs(found["difference"].iloc[0] - effect) < found["within"].iloc[0] < 0.05
    twins = twin_table(planted()).set_index(["kind", "measure"])
    assert set(twins.index.get_level_values("kind")) == {"loose", "medium"}
    one = twins.loc[("medium", "q/p at 0.5 %")]
    assert abs(one["difference"] - 0.2) < one["within"] and one["corrected"] < 0.05

"""Observables of a real run compared with the critical-state table; the peak of a curve."""

import numpy as np
import pytest

import labkit
from analysis.speed_error.observables import CHECKS, OBSERVABLES, PEAK, max_of_means, observables
from labkit.results.critical import critical_states


def test_those_of_the_critical_state_are_those_of_labkit_critical(run_file):
    run = labkit.open_run(run_file)
    found, row = observables(run, None), critical_states({"run": run}).iloc[0]
    assert set(found) == {*OBSERVABLES, *CHECKS}
    for name, column in (
        ("ratio_critical", "M"),
        ("void_ratio_critical", "e"),
        ("Z_critical", "Z"),
        ("Lambda_critical", "Lambda"),
        ("A_critical", "A_zz"),
        ("Ft_critical", "Ft_zz"),
    ):
        assert found[name] == pytest.approx(row[column], rel=1e-12)
    assert found["pressure_critical"] == pytest.approx(1e6 * row["p_MPa"], rel=1e-12)
    assert np.isnan(found["held_error"]) and np.isnan(found["ratio_5"])  # a CV test to 2 %
    ratio = (run.lab.deviatoric_stress() / run.lab.mean_stress()).values
    around = (run["axial_strain"].values > 0.0076) & (run["axial_strain"].values < 0.0124)
    assert found["ratio_1"] == pytest.approx(ratio[around].mean(), rel=0.01)


def test_the_peak_is_the_largest_mean_over_its_strain():
    strain = np.arange(0.0, 0.2001, 1e-3)
    rng = np.random.default_rng(0)
    values = np.exp(-(((strain - 0.05) / 0.03) ** 2)) + 0.05 * rng.normal(size=len(strain))
    width = round(PEAK / 1e-3)
    slow = max(values[k - width : k + 1].mean() for k in range(width, len(strain)))
    assert max_of_means(strain, values) == pytest.approx(slow, rel=0.01)
    assert max_of_means(strain, np.full(len(strain), 0.9)) == pytest.approx(0.9, rel=1e-12)

"""Statistics of independent specimens against known truths and against statsmodels."""

import numpy as np
import pandas
import pytest
from statsmodels.regression.linear_model import OLS
from statsmodels.regression.mixed_linear_model import MixedLM

from analysis.statistics import adjusted, cluster_mean, paired_difference, verdict
from analysis.statistics.one_line import RATIOS, MixedModel, one_line
from analysis.statistics.stationarity import slope_of, slope_table, stationarity_table


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def correlated(rng, rho, n):
    """n values with unit variance and correlation rho between neighbours."""
    values = rng.normal(size=n)
    for k in range(1, n):
        values[k] = rho * values[k - 1] + np.sqrt(1.0 - rho**2) * values[k]
    return values


@pytest.mark.parametrize("rho", [0.0, 0.8, 0.95])
def test_intervals_of_slopes_contain_the_truth_despite_correlated_records(rng, rho):
    strain = np.linspace(0.3, 0.4, 101)
    found = [slope_of(strain, 2.0 * strain + correlated(rng, rho, 101)) for _ in range(200)]
    assert np.mean([abs(slope.value - 0.2) <= slope.within for slope in found]) > 0.85
    assert np.mean([slope.p_value < 0.05 for slope in found]) < 0.17
    assert np.median([slope.n for slope in found]) <= max(2, 1.4 * 101 * (1.0 - rho) / (1.0 + rho))


def test_slopes_that_cannot_be_measured_are_nan_and_constants_do_not_drift():
    assert np.isnan(slope_of([0.0, 0.1, 0.2], [1.0, 2.0, 3.0]).value)
    assert np.isnan(slope_of(np.linspace(0, 1, 20), [np.nan] * 20).value)
    constant = slope_of(np.linspace(0, 1, 20), np.ones(20))
    assert (constant.value, constant.within, constant.p_value) == (0.0, 0.0, 1.0)
    assert slope_of(np.linspace(0, 1, 20), np.linspace(0, 3, 20)).value == pytest.approx(0.3)


def test_a_drift_is_found_over_specimens_and_a_stationary_quantity_passes(rng):
    strain = np.linspace(0.0, 0.4, 401)
    runs = [
        pandas.DataFrame(
            {
                "run": f"cv-{k}",
                "specimen": f"s{k // 2}",
                "path": "cv",
                "strain": strain,
                "M": 0.9 - 0.3 * strain + 0.002 * correlated(rng, 0.95, 401),
                "Z": 5.0 + 0.01 * correlated(rng, 0.95, 401),
                "A": 0.4 + 0.2 * correlated(rng, 0.95, 401),
            }
        )
        for k in range(16)
    ]
    slopes = slope_table(pandas.concat(runs), ["M", "Z", "A"], 0.3, by=["path"])
    assert len(slopes) == 48
    found = stationarity_table(slopes, by=["path"]).set_index("quantity")
    assert found["verdict"].to_dict() == {"M": "drifts", "Z": "stationary", "A": "not resolved"}
    assert found.loc["M", "slope"] == pytest.approx(-0.03, abs=0.005)
    assert (found["specimens"] == 8).all() and (found["tests"] == 16).all()
    assert found.loc["Z", "passed"] >= 12


def test_a_specimen_counts_once():
    values, specimens = [1.0, 1.0, 1.0, 4.0], ["a", "a", "a", "b"]
    assert cluster_mean(values, specimens).value == 2.5 and cluster_mean(values, specimens).n == 2
    assert cluster_mean(values).value == 1.75 and cluster_mean(values).n == 4
    assert cluster_mean([np.nan, 2.0]).n == 1 and np.isnan(cluster_mean([np.nan, 2.0]).within)
    assert cluster_mean([]).n == 0
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(300):
        packing = np.repeat(rng.normal(size=6), 4)
        found = cluster_mean(packing + 0.3 * rng.normal(size=24), np.repeat(np.arange(6), 4))
        inside.append(abs(found.value) <= found.within)
    assert 0.91 < np.mean(inside) < 0.985


def test_pairs_cancel_the_scatter_of_specimens(rng):
    packing = rng.normal(size=8)
    table = pandas.DataFrame(
        {
            "specimen": np.tile(np.arange(8), 2),
            "law": np.repeat(["a", "b"], 8),
            "M": np.concatenate([packing, packing + 0.1]) + 1e-3 * rng.normal(size=16),
        }
    )
    found = paired_difference(table, "M", "law", "a", "b")
    assert found.value == pytest.approx(0.1, abs=2e-3) and found.within < 2e-3 and found.n == 8
    assert paired_difference(table, "M", "law", "a", "c").n == 0


def test_specimens_tested_once_give_the_f_test_of_least_squares(rng):
    e = rng.uniform(0.6, 0.75, 20)
    path = np.array(["cv", "cr"] * 10)
    Z = 4.0 + 5.0 * (0.76 - e) + 0.05 * rng.normal(size=20) + 0.06 * (path == "cv")
    line = np.column_stack([np.ones(20), e])
    full = OLS(Z, np.column_stack([line, path == "cv"])).fit()
    found = one_line(Z, line, path)
    f, p, _ = full.compare_f_test(OLS(Z, line).fit())
    assert (found.statistic, found.p_value) == pytest.approx((f, p), rel=1e-9)
    offsets = found.offsets.set_index("group")
    assert offsets.loc["cv", "offset"] == pytest.approx(full.params[2], rel=1e-9)
    assert offsets.loc["cv", "within"] == pytest.approx(float(np.diff(full.conf_int()[2])[0]) / 2, rel=1e-9)
    assert one_line(Z, line, 30.0 * e).p_value != one_line(Z, line, path).p_value
    assert np.isnan(one_line(Z, line, np.array(["cv"] * 20)).p_value)
    covariate = one_line(Z, line, e**2)
    assert covariate.offsets["group"].tolist() == ["slope"]


def test_the_likelihood_of_shared_specimens_is_that_of_statsmodels(rng):
    specimen = np.repeat(np.arange(10), 3)
    columns = np.column_stack([np.ones(30), rng.normal(size=30)])
    y = columns @ [1.0, 2.0] + rng.normal(size=10)[specimen] + 0.5 * rng.normal(size=30)
    best = [MixedLM(y, columns[:, :k], groups=specimen).fit(reml=False).llf for k in (1, 2)]
    own = [MixedModel(columns[:, :k], specimen[:, None] == specimen).likelihood(y[:, None])[0] for k in (1, 2)]
    assert own[1] - own[0] == pytest.approx(best[1] - best[0], abs=0.1)
    assert RATIOS[0] == 0.0


def test_groups_that_share_specimens_are_judged_by_specimens():
    rng = np.random.default_rng(5)
    specimen = np.repeat(np.arange(8), 4)
    line, density = np.ones((32, 1)), np.where(specimen < 4, "loose", "dense")
    p_values, naive = [], []
    for _ in range(30):
        y = rng.normal(size=8)[specimen] + 0.2 * rng.normal(size=32)
        p_values.append(one_line(y, line, density, specimen, draws=199).p_value)
        naive.append(one_line(y, line, density).p_value)
    assert np.mean(np.array(p_values) < 0.05) < 0.17
    assert np.mean(np.array(naive) < 0.05) > 0.3  # counting tests instead of specimens
    shifted = one_line(y + 6.0 * (density == "loose"), line, density, specimen)
    assert shifted.p_value < 0.01 and shifted.offsets["specimens"].sum() == 8 and shifted.shared > 0.5


def test_corrections_and_verdicts():
    p = np.array([0.01, np.nan, 0.04, 0.03])
    assert adjusted(p) == pytest.approx([0.03, np.nan, 0.06, 0.06], nan_ok=True)
    assert adjusted(p, "fdr_bh") == pytest.approx([0.03, np.nan, 0.04, 0.04], nan_ok=True)
    assert np.isnan(adjusted([np.nan])).all()
    assert verdict(0.06, 0.01, 0.05) == "differs"
    assert verdict(0.02, 0.01, 0.05) == "agrees"  # resolved, but too small to matter
    assert verdict(0.06, 0.01, 0.05, rounding=0.06) == "not resolved"
    assert verdict(0.06, 0.01, 0.05, p_value=0.2) == "not resolved"
    assert verdict(0.0, 0.06, 0.05) == "not resolved"
    assert verdict(0.02, np.nan, 0.05) == "not resolved"


def test_a_large_offset_of_a_group_does_not_widen_its_own_interval(rng):
    specimen = np.repeat(np.arange(12), 2)
    group = np.where(specimen < 6, "compression", "extension")
    y = 0.2 * (specimen < 6) + 0.005 * rng.normal(size=12)[specimen] + 0.005 * rng.normal(size=24)
    found = one_line(y, np.ones((24, 1)), group, specimen, draws=19).offsets.set_index("group").loc["compression"]
    difference = cluster_mean(y[:12], specimen[:12]).value - cluster_mean(y[12:], specimen[12:]).value
    assert found["offset"] == pytest.approx(difference) and 0.003 < found["within"] < 0.015

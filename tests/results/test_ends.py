"""The ends of shear tests and the numbers of compression: stationarity, the critical-state line, C_c, C_s and K0."""

import numpy as np
import pandas
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.figures.critical_figure import ends_of_tests
from labkit.results import slope
from labkit.results.critical import at_end, critical_states, line_of, verdicts
from tests.conftest import ROOT

RUN = ROOT / "results/paper/runs/cv-dense.run.nc"


@pytest.fixture
def ended():
    """A function that returns a test whose last quarter has constant stresses and this relative change of e."""
    run = lk.open_run(RUN)

    def with_change(change, sign=1.0):
        made = run.copy(deep=True)
        last = at_end(made["axial_strain"].values)
        strain = made["axial_strain"].values[last]
        made["stress"].values[last] = np.diag([0.7, 0.7, 1.6]) * 1e6
        made["void_ratio"].values[last] = 0.7 * (1.0 + change * (strain - strain.mean()) / np.ptp(strain))
        if sign < 0.0:
            made["stress"].values[:] = made["stress"].values[:, ::-1, ::-1]
        return made

    return with_change


def test_the_slope_of_a_line_with_correlated_noise_lies_in_its_interval():
    random, inside = np.random.default_rng(3), 0
    x = np.linspace(0.3, 0.4, 100)
    for _ in range(200):
        noise = np.zeros(100)
        for k, step in enumerate(random.normal(size=99), start=1):
            noise[k] = 0.8 * noise[k - 1] + step
        found = slope(x, 5.0 + 20.0 * x + 0.01 * noise)
        inside += abs(found.value - 2.0) <= found.within
    assert 0.88 < inside / 200 < 0.99
    assert np.isnan(slope(x[:5], x[:5]).value) and slope(x, np.ones(100)).verdict == "stationary"


def test_an_end_is_called_critical_only_if_it_is_stationary(ended):
    states = critical_states({"still": ended(0.0), "falls": ended(-0.03)})
    assert states["critical"].tolist() == ["yes", "e drifts"]
    assert states["e_slope"][1] == pytest.approx(-0.03 / 0.1 * 0.1, rel=0.02)  # 3 % over a quarter of 40 % strain
    said = verdicts(states)
    assert said[0] == "shown to be critical: still" and "falls" in said[1] and "e drifts" in said[1]


def test_markers_are_the_means_of_the_table_and_filled_only_if_critical(ended):
    runs = {"still": ended(0.0), "falls": ended(-0.03)}
    states = critical_states(runs)
    figure = ends_of_tests(runs, states, line_of(states))
    points = [line for line in figure.axes[0].get_lines() if len(line.get_xdata()) == 1]
    for point, (_, state) in zip(points, states.iterrows(), strict=True):
        assert (point.get_xdata()[0], point.get_ydata()[0]) == (state["p_MPa"], state["e"])
        assert (point.get_markerfacecolor() == "white") == (state["critical"] != "yes")


def test_the_line_and_the_state_parameter_are_those_of_the_formula():
    p = np.array([0.05, 0.2, 1.0])
    for exponent, term in ((0.7, (p / 0.1) ** 0.7), (0.0, np.log(p / 0.1))):
        table = pandas.DataFrame({"p_MPa": p, "e": 0.9 - 0.03 * term, "critical": "yes"})
        line = lk.critical_line(table, exponent)
        assert (line.e_0, line.slope) == pytest.approx((0.9, 0.03)) and line.scatter < 1e-12
        assert line.state_parameter(0.7, 1e6) == pytest.approx(0.7 - table["e"].iloc[-1])
    assert line_of(table)[1].startswith("critical-state line: e_c = ")
    assert "not shown to be critical" in line_of(table.assign(critical="e drifts"))[1]
    with pytest.raises(InputError, match="needs two tests or more, and the table has 1"):
        lk.critical_line(table.iloc[:1])


def test_the_interval_of_the_line_contains_the_true_line_in_95_of_100_cases():
    random, inside, p = np.random.default_rng(5), [], np.array([0.05, 0.1, 0.3, 0.3, 1.0])
    for exponent, term in ((0.7, (p / 0.1) ** 0.7), (0.0, np.log(p / 0.1))):
        for _ in range(500):
            e = 0.9 - 0.03 * term + random.normal(scale=0.01, size=5)
            line = lk.critical_line(pandas.DataFrame({"p_MPa": p, "e": e}), exponent)
            inside.append(np.abs(line.void_ratio(1e6 * p) - 0.9 + 0.03 * term) <= line.within(1e6 * p))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)
    assert line.tests == line.specimens == 5
    two = lk.critical_line(pandas.DataFrame({"p_MPa": p[:2], "e": [0.9, 0.88], "specimen": [1, 1]}))
    assert np.isnan(two.within([1e5, 2e5])).all() and str(two).endswith("2 tests of 1 specimen")


def test_the_figure_shades_the_interval_of_the_line_whose_label_counts_the_specimens(ended):
    """Three tests of one specimen and one of another."""
    runs = {name: ended(0.0) for name in ("100", "200", "400", "other")}
    for factor, run in zip((1.0, 2.0, 4.0, 3.0), runs.values(), strict=True):
        run["stress"].values[:] *= factor
        run["void_ratio"].values[:] -= 0.01 * factor**1.5
    runs["other"].attrs["seed"] += 1
    states = critical_states(runs)
    assert states["specimen"].tolist() == [1, 1, 1, 2]
    line, label = line_of(states)
    assert label.endswith("4 tests of 2 specimens")
    (band,) = ends_of_tests(runs, states, (line, label)).axes[0].collections
    low, high = band.get_paths()[0].get_extents().intervaly
    assert low < states["e"].min() and high > states["e"].max() - 0.01
    assert "95 % interval of the line" in band.get_label()


def test_compression_has_its_indices_and_k0():
    run = lk.open_run(RUN).isel(time=slice(0, 300)).copy(deep=True)
    n = run.sizes["time"]
    up, down = n - n // 3, n // 3
    vertical = np.concatenate([np.geomspace(50e3, 1e6, up), np.geomspace(1e6, 200e3, down + 1)[1:]])
    e = 0.9 - 0.1 * np.log10(vertical / 50e3)
    e[up:] = e[up - 1] + 0.02 * np.log10(1e6 / vertical[up:])
    run["void_ratio"].values[:] = e
    run["stress"].values[:] = vertical[:, None, None] * np.diag([0.44, 0.46, 1.0])
    with pytest.raises(InputError, match="run cv is a shear test"):
        lk.compression_numbers(run)
    run["strain"].values[:] *= np.diag([0.0, 0.0, 1.0])
    found = lk.compression_numbers(run)
    assert (found.compression_index, found.swelling_index, found.K0) == pytest.approx((0.1, 0.02, 0.45), rel=1e-5)
    assert "C_c = 0.1, C_s = 0.02, K0 = 0.450" in str(found)
    run["stress"].values[:, 0, 0] *= np.linspace(4.0, 1.0, n)  # it falls
    falls = lk.compression_numbers(run)
    assert f"K0 = {falls.K0:.3f}, {falls.K0_at_end:.3f} at the end" in str(falls) and falls.K0_at_end < falls.K0 - 0.02
    run["strain"].values[:] += run["strain"].values[:, 2:, 2:] * np.diag([1.0, 1.0, 0.0])
    assert "K0" not in str(lk.compression_numbers(run))  # isotropic compression has none
    with pytest.raises(InputError, match="sigma_z doubles"):
        lk.compression_numbers(run.isel(time=slice(0, 3)))


def test_a_collapse_during_loading_is_no_unloading():
    """sigma_z of a loose specimen falls to a third while e falls too; the unloading, 500 to 100 kPa, comes later."""
    run = lk.open_run(RUN).isel(time=slice(0, 9)).copy(deep=True)
    vertical = np.array([20e3, 60e3, 20e3, 200e3, 500e3, 100e3, 600e3, 800e3, 1e6])
    run["stress"].values[:] = vertical[:, None, None] * np.diag([0.5, 0.5, 1.0])
    run["strain"].values[:] *= np.diag([0.0, 0.0, 1.0])
    run["void_ratio"].values[:] = [0.85, 0.84, 0.82, 0.81, 0.80, 0.81, 0.79, 0.785, 0.78]
    assert lk.compression_numbers(run).swelling_index == pytest.approx(0.01 / np.log10(5.0))

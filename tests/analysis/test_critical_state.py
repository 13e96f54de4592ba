"""The critical state at large strain: the questions that the tests must answer, with planted answers."""

import numpy as np
import pandas
import pytest
import xarray as xr

import labkit as lk
from analysis.critical_state.ends import factors, packing
from analysis.critical_state.questions import curvature, direction, one_critical_state, stationarity
from analysis.critical_state.study import STUDY
from analysis.paper.lines import critical_Lambda, critical_Z
from labkit.micro import mean_stress

pytestmark = pytest.mark.long


def planted(lower_M=0.0):
    """Ends of 27 tests of 27 specimens, scattered about the paper's lines; dense ones have q/p lower by `lower_M`."""
    rng = np.random.default_rng(2)
    rows = []
    for density, e in (("dense", 0.61), ("medium", 0.67), ("loose", 0.72)):
        for seed in range(9):
            path = ("cv", "cp", "cr")[seed % 3]
            at = e + rng.normal(0.0, 0.01)
            rows.append(
                {
                    "run": f"{path}-{density}-s{seed}",
                    "test": path,
                    "specimen": f"{density}-s{seed}",
                    **factors(path, density),
                    "lode": 0.0,
                    "M": 0.92 - lower_M * (density == "dense") + rng.normal(0.0, 0.005),
                    "A": 0.45 + rng.normal(0.0, 0.01),
                    "F": 0.77 + rng.normal(0.0, 0.01),
                    "Ft": 0.045 + rng.normal(0.0, 0.001),
                    "e": at,
                    "Z": float(critical_Z(at)) + rng.normal(0.0, 0.02),
                    "Lambda": float(critical_Lambda(at)) + rng.normal(0.0, 2e-4),
                    "p_MPa": 20.0 * (0.76 - at) * (1.0 + rng.normal(0.0, 0.02)),
                }
            )
    return pandas.DataFrame(rows)


def test_names_say_what_a_test_is():
    assert factors("cv_full_series", "full_series_dense") == {
        "path": "cv",
        "density": "dense",
        "stiffness": "series",
        "size": "full",
        "cell": "tall",
    }
    assert packing("flat_medium_500-s11") == "flat_medium-s11"
    tests = {"cv": "compression", "cr_extension": "extension", "shear": "simple shear", "triaxial_b05": "true triaxial"}
    assert {test: direction(test) for test in tests} == tests


def test_a_curve_over_the_lode_angle_does_not_change_the_direct_comparison():
    ends = pandas.concat([planted().assign(lode=0.0), planted().assign(lode=30.0), planted().assign(lode=60.0)])
    ends["specimen"] += "-" + ends["lode"].astype(str)
    ends["test"] = ends["lode"].map({0.0: "cp", 30.0: "triaxial_b05", 60.0: "cp_extension"})
    ends["M"] += ends["lode"].map({0.0: 0.0, 30.0: -0.14, 60.0: -0.2})
    asked = one_critical_state(ends).set_index(["quantity", "group"]).loc[("M", "extension")]
    assert asked["offset"] == pytest.approx(-0.2, abs=asked["within"]) and asked["within"] < 0.01
    sag = curvature(ends).set_index("quantity").loc["M"]
    assert sag["sag"] == pytest.approx(-0.04, abs=sag["within"]) and sag["corrected"] < 0.01


def test_shear_beyond_100_percent_is_judged_at_its_own_end():
    strain = np.linspace(0.0, 1.73, 101)
    columns = dict.fromkeys(("A", "F", "Ft", "Z", "Lambda", "e", "p_MPa"), np.ones(101))
    M = np.where(strain < 1.2, 0.8, 0.8 - 0.1 * (strain - 1.2))
    tests = [
        pandas.DataFrame(
            {"run": f"r{k}", "test": "shear", "specimen": f"s{k}", "strain": strain, **columns, "M": M + k}
        )
        for k in range(3)
    ]
    slopes = stationarity(pandas.concat(tests)).set_index(["window", "quantity"])["slope"]
    assert slopes["70-100 %", "M"] == pytest.approx(-0.01, rel=0.01)


def test_an_offset_of_one_density_is_found_and_none_is_invented():
    for lower, found in ((0.05, True), (0.0, False)):
        table = one_critical_state(planted(lower))
        of_M = table[(table["quantity"] == "M") & (table["factor"] == "density")]
        assert (of_M["corrected"].iloc[0] < 0.05) == found
        others = table[(table["quantity"] != "M") & table["corrected"].notna()]
        assert (others["corrected"] > 0.05).all()


def test_a_drift_is_resolved_only_where_there_is_one():
    rng = np.random.default_rng(1)
    strain = np.linspace(0.0, 1.0, 101)
    tests = []
    for seed in range(5):
        noise = rng.normal(0.0, 0.002, strain.size)
        values = dict.fromkeys(("A", "F", "Ft", "Z", "Lambda", "e", "p_MPa"), 1.0 + noise)
        falling = 0.92 + np.where(strain < 0.5, -0.3 * (strain - 0.5), 0.0) + noise
        tests.append(
            pandas.DataFrame(
                {"run": f"r{seed}", "test": "cv", "specimen": f"s{seed}", "strain": strain, "M": falling, **values}
            )
        )
    table = stationarity(pandas.concat(tests)).set_index(["window", "quantity"])["verdict"]
    assert table["30-40 %", "M"] == "drifts" and table["70-100 %", "M"] == "stationary"
    assert table["30-40 %", "Z"] == "stationary"


def test_the_data_set_holds_what_the_runs_hold(tmp_path):
    """Records, and the equations related to C0 at the snapshots, whose errors add up to that of C0."""
    state = lk.make_specimen(lk.Recipe(0.67, grains=150, step1_friction=0.15), progress=False)
    path, file = lk.paths.SimpleShear(pressure=0.3e6, strain=0.03, rate=60.0), tmp_path / "shear-s1.run.nc"
    run = lk.run(state, path, file=file, snapshots=2, progress=False)
    STUDY.gather([file], tmp_path / STUDY.data, "a command")
    with xr.open_dataset(tmp_path / STUDY.data) as data:
        kept = data.sel(run="shear-s1").load()
    love = run.data["stress"].values
    assert kept["stress"].values[[0, -1]] == pytest.approx(love[[0, -1]], rel=1e-6)
    assert kept["accumulated_strain"].values[-1] == pytest.approx(0.03, rel=1e-2)
    assert str(kept["path"].values) == "simple_shear" and '"strain": 0.03' in str(kept["path_parameters"].values)
    error = kept["error_budget"].sum("part").values
    c0 = kept["stress_family"].sel(form="c0").values
    assert c0 - kept["snapshot_stress"].values == pytest.approx(error, abs=1e-4 * mean_stress(love[0]))

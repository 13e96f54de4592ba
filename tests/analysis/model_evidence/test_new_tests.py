"""Tests that no model was fitted to: how they are read, and errors with a known answer."""

import json

import numpy as np
import pytest
import xarray as xr

from analysis.model_evidence.calibrations import VARIANTS
from analysis.model_evidence.new_tests import NOT_FITTED, new_combined, new_errors, new_tests
from labkit.model import Model, as_run, drive, isotropic_state, model_path

POINTS = 41


def data_of(tests):
    """A data set like that of ./lab critical-state (single precision), whose tests are runs of the model of Table 2."""
    model, parts = Model().reading(beyond_e_cmax="flat"), []
    for k, name in enumerate(tests):
        path = model_path("cv", 0.0, strain=-0.3 if "extension" in name else 0.3)
        run = as_run(drive(model, path, isotropic_state(model, 0.67, 5e5, Z=5.0 + 0.1 * k)))
        accumulated = np.abs(run["axial_strain"].values)
        chosen = np.abs(accumulated[:, None] - np.linspace(0.0, 0.3, POINTS)).argmin(axis=0)
        keep = ["strain", "stress", "void_ratio", "void_ratio_nominal", "coordination_number"]
        part = run[keep].isel(time=chosen).drop_vars("time").rename(time="point").reset_coords(drop=True)
        part["accumulated_strain"] = ("point", accumulated[chosen])
        parts.append(part)
    names = {
        "run": tests,
        "test": [n.partition("-")[0] for n in tests],
        "specimen": [n.partition("-")[2] for n in tests],
    }
    names["path"] = ["cv"] * len(tests)
    names["path_parameters"] = [json.dumps({"strain": -0.3 if "extension" in n else 0.3}) for n in tests]
    return xr.concat(parts, "run").astype("f4").assign_coords({key: ("run", values) for key, values in names.items()})


@pytest.fixture(scope="module")
def found():
    data = data_of(
        [
            "cv-loose-s1",
            "cv-loose-s2",
            "cv-loose-s6",
            "cv_extension-flat-s3",
            "cv_series-series_loose-s4",
            "shear-cube-s5",
        ]
    )
    runs = new_tests(data, 0.2)
    calibrations = {(variant, NOT_FITTED): Model().with_parameters(A_c=0.7) for variant in VARIANTS}
    return runs, new_errors(runs, calibrations)


def test_tests_with_the_papers_stiffness_are_read_up_to_the_strain(found):
    runs, _ = found
    assert list(runs) == ["cv-loose-s1", "cv-loose-s2", "cv-loose-s6", "cv_extension-flat-s3"]
    for name, run in runs.items():
        end = -0.2 if "extension" in name else 0.2
        assert json.loads(run.attrs["path_parameters"])["strain"] == end
        assert float(run["axial_strain"][-1]) == pytest.approx(end, abs=0.3 / POINTS)


def test_a_model_that_made_the_tests_has_no_error_and_another_one_has(found):
    errors = found[1].set_index(["model", "path"])
    for path in ("cv", "cv_extension"):
        assert errors.loc[("Table 2", path), "q_error"].max() < 2e-3
        assert errors.loc[("calibrated", path), "q_error"].min() > 0.02
    rows = new_combined(found[1]).set_index(["direction", "model"])
    assert rows.loc[("compression", "calibrated"), "ratio"] > 10.0
    assert rows.loc[("compression", "calibrated"), "specimens"] == 3

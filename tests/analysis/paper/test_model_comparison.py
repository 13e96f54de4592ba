"""The model against its own runs: no error with the same parameters, and a calibration that recovers them."""

import json

import numpy as np
import pandas
import pytest

import labkit
from analysis.paper import model_comparison as comparison
from analysis.paper.ends import in_memory
from analysis.paper.report_numbers import model_errors
from analysis.paper.tables import write_tables
from labkit.model import Model
from tests.analysis.paper.conftest import make

pytestmark = pytest.mark.long

TRUTH = {"c_eZ": 6.0, "c_M": 80.0, "F_c": 0.97, "c_cLam": 0.105}
FEW = (
    "cv-dense cv-medium cv-loose cp_500kPa-medium cr_1MPa-loose isoc-loose isod-dense_high cr_500kPa-dense "
    "cyclic-cyclic_loose"
).split()


@pytest.fixture(scope="module")
def other_runs(tmp_path_factory):
    """Some tests of a material other than that of Table 2."""
    files = make(tmp_path_factory.mktemp("other"), Model().with_parameters(**TRUTH), FEW, strain=0.4)
    return {name: labkit.open_run(file) for name, file in files.items()}


def test_its_own_runs_are_followed(known):
    errors = comparison.compare(known, comparison.models(None))
    errors = errors[errors["parameters"] == comparison.TABLE_2]
    assert set(errors["run"]) == set(known)
    assert (errors["reached"] > 0.98).all()
    assert (errors[["q_error", "p_error"]].max() < 0.03).all()  # the scatter added to the tests
    assert errors["e_error"].max() < 1e-3
    assert np.isnan(errors.set_index("run")["e_error"]["cv-dense"])  # e is given


def test_a_calibration_finds_another_material(other_runs):
    known = in_memory(other_runs)
    found, other = comparison.calibrate(known)
    table = comparison.parameters(found, other).set_index("parameter")
    for name, value in TRUTH.items():
        assert table["ours"][name] == pytest.approx(value, rel=0.05), name
    assert not table["table_2_inside"][["c_cLam", "c_eZ", "F_c"]].any()
    errors = comparison.compare(known, comparison.models(found))
    median = errors.groupby("parameters")["q_error"].median()
    assert median[comparison.OURS] < 0.01 and median[comparison.OURS] < 0.5 * median[comparison.TABLE_2]
    assert errors.set_index(["run", "parameters"])["calibrated_on"]["cv-dense", comparison.OURS]
    assert not errors.set_index(["run", "parameters"])["calibrated_on"]["cyclic-cyclic_loose", comparison.OURS]


def test_a_path_that_the_model_cannot_finish_has_a_status(known):
    """Z vanishes in isotropic dilation to a low pressure."""
    run = known["isod-loose"].copy()
    parameters = json.loads(run.attrs["path_parameters"])
    run.attrs["path_parameters"] = json.dumps({**parameters, "pressure": 1.0, "strain": -0.3})
    longer = run.assign(axial_strain=run["axial_strain"] * 4.0)
    errors = comparison.compare({"isod-loose": longer}, comparison.models(None))
    assert errors["reached"][0] < 1.0 and errors["status"][0]
    assert [row["run"] for row in model_errors(errors)["stopped"]] == ["isod-loose"]
    longest = run.assign(axial_strain=run["axial_strain"] * 40.0)
    errors = comparison.compare({"isod-loose": longest}, comparison.models(None))
    assert errors["reached"][0] < comparison.FAR_ENOUGH and np.isnan(
        errors["p_error"][0]
    )  # NaN rather than a small error
    assert model_errors(errors)["per_test"].iloc[0].tolist() == ["isod-loose", "ended", "ended", "ended"]


def test_all_tables_are_written_and_read(other_runs, tmp_path):
    files = write_tables(other_runs, tmp_path / "tables")
    assert all(file.stat().st_size > 0 for file in files)
    numbers = pandas.read_csv(tmp_path / "tables/fidelity.csv").set_index("number")
    assert numbers["agrees"]["M"] in ("yes", "no") and numbers["agrees"]["CP 1"] == "no runs"
    sff = pandas.read_csv(tmp_path / "tables/sff.csv")
    assert (sff["worst"] < 1e-6).all() and "cyclic-cyclic_loose" not in set(sff["run"])
    assert Model.from_json((tmp_path / "tables/calibrated.json").read_text()).readings.beyond_e_cmax == "error"
    errors = pandas.read_csv(tmp_path / "tables/model_errors.csv").set_index(["run", "parameters"])
    assert {(name, label) for name in FEW for label in (comparison.TABLE_2, comparison.OURS)} <= {*errors.index}
    assert errors["reached"]["cyclic-cyclic_loose", comparison.OURS] > 0.98


def test_tables_without_the_tests_they_need(other_runs, tmp_path):
    files = write_tables({"cyclic-cyclic_loose": other_runs["cyclic-cyclic_loose"]}, tmp_path)
    assert not any(file.name == "calibrated.json" for file in files)
    assert "Table 2" in (tmp_path / "model_errors.md").read_text()

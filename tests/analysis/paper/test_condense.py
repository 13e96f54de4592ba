"""Reduced run files contain the records of the run and the statistics of its contacts."""

import numpy as np
import pytest
import xarray as xr

import labkit
from analysis import paper
from analysis.paper.condense import condense
from labkit.errors import InputError
from labkit.files.provenance import check

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def thin(run_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    (folder / "runs").mkdir()
    assert condense(run_file, folder / "runs" / "cv-small.run.nc", "labkit paper")
    return folder


def test_records_are_the_same_in_single_precision(thin, run_file):
    with labkit.open_run(run_file) as run, paper.runs(thin)["cv-small"] as found:
        records_agree(run, found)


def records_agree(run, found):
    assert found.sizes["time"] == run.sizes["time"] and found.sizes["snapshot"] == 0
    for name in ("stress", "stress_sff", "void_ratio", "mean_normalised_force", "contact_anisotropy", "axial_strain"):
        np.testing.assert_allclose(found[name], run[name], rtol=2e-7, atol=1e-7 * float(np.abs(run[name]).max()))
    np.testing.assert_allclose(found.lab.deviatoric_stress(), run.lab.deviatoric_stress(), rtol=1e-4, atol=50.0)
    assert found.attrs["scene"] == run.attrs["scene"] and found.attrs["source_sha256"] == run.attrs["data_sha256"]


def test_statistics_of_the_contacts(thin, run_file):
    with labkit.open_run(run_file) as run, xr.open_dataset(thin / "runs" / "cv-small.run.nc", group="derived") as found:
        love = run.lab.love_stress()
        c0 = found["stress_family"].sel(form="c0")
        np.testing.assert_allclose(found["error_budget"].sum("part"), c0 - love, atol=1e-6 * float(love.max()))
        np.testing.assert_array_equal(found["record"], run["record"])
        assert found["record"].dtype.kind == "i"


def test_a_run_is_reduced_once(thin, run_file):
    file = thin / "runs" / "cv-small.run.nc"
    assert not condense(run_file, file, "labkit paper")
    assert ("the data of this file", "same") in check(file)


def test_a_folder_without_runs_is_refused(tmp_path):
    with pytest.raises(InputError, match="lab paper"):
        paper.runs(tmp_path)

"""The error of C0 in real contacts: its parts add up, computed from the contacts or read from a reduced file."""

import shutil

import pytest

import labkit
from analysis.paper.sff_errors import sff_errors
from labkit.sff.budget import PARTS

pytestmark = pytest.mark.long


def test_the_parts_add_up(run_file):
    row = sff_errors({"small": labkit.open_run(run_file)}).iloc[0]
    assert row["records"] > 0 and 0.0 < row["mean"] <= row["worst"] < 0.1
    assert row[list(PARTS)].sum() == pytest.approx(1.0)
    assert row["fourth"] < row["snapshot_error"] <= row["worst"] * (1 + 1e-9)
    assert bool(row["explanation"]) == (row["over"] > 0)


def test_a_file_with_a_stored_budget_gives_the_same(run_file, tmp_path):
    thin = tmp_path / "thin.run.nc"
    shutil.copy(run_file, thin)
    run = labkit.open_run(run_file)
    told = run.lab.error_budget().to_dataset(name="error_budget")
    told = told.assign(stress_family=run.lab.sff_family(), record=run["record"]).drop_vars("row_start", errors="ignore")
    told.to_netcdf(thin, mode="a", group="derived")
    opened = (labkit.open_run(file, verify=file == run_file) for file in (run_file, thin))
    expected, found = (sff_errors({"small": run}).iloc[0] for run in opened)
    assert list(expected) == pytest.approx(list(found), nan_ok=True) or expected.equals(found)

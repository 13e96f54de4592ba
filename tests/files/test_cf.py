"""State and run files follow the CF conventions 1.10, and labkit and xarray read them with the time in s."""

import shutil
import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

import labkit as lk
import labkit.results.dataset  # registers the accessor of a tree
from labkit.files.hashes import data_sha256
from labkit.files.schema import TIME
from tests.changed import changed

pytestmark = pytest.mark.slow

CHECKER = Path(sys.executable).with_name("compliance-checker")
TIME_NAME = "time since the start of the path"
SKIPPED = "check_invalid_same_named_dimension_across_groups"  # version 6.1 fails in any file with two groups


@pytest.fixture(params=["specimen_file", "run_file", "liquefied_file"])
def file(request):
    return request.getfixturevalue(request.param)


@pytest.fixture
def older(run_file, tmp_path):
    """A copy of a run file with the attributes of the paper's stored runs."""
    file = shutil.copy(run_file, tmp_path / "older.run.nc")
    with changed(file) as dataset:
        for name in ("title", "comment"):
            dataset.delncattr(name)
        dataset.history = ""
        for name in set(TIME) - {"units"}:
            dataset["time"].delncattr(name)
        dataset["time"].units = "s"
    return file


@pytest.mark.skipif(not CHECKER.exists(), reason="compliance-checker is not installed: pip install -e '.[test]'")
def test_the_cf_checker_accepts_the_file(file):
    words = [CHECKER, "--test=cf:1.10", "--criteria=strict", f"--skip-checks={SKIPPED}", file]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0 and "All tests passed!" in done.stdout, done.stdout + done.stderr


def test_titles_history_units_and_the_standard_name_are_written(file):
    with netCDF4.Dataset(file) as dataset:
        assert dataset.labkit_file in dataset.title and dataset.history and dataset.Conventions == "CF-1.10"
        assert "featureType" not in dataset.ncattrs()
        for group in (dataset, *dataset.groups.values()):
            for name, variable in group.variables.items():
                assert variable.units and variable.long_name, name
                assert ("standard_name" in variable.ncattrs()) == (name == "time")


def test_attributes_of_conventions_leave_data_and_digest_as_they_were(run_file, older):
    with lk.open_run(run_file) as new, lk.open_run(older) as old:
        xr.testing.assert_equal(new, old)
        assert new["time"].attrs == old["time"].attrs == {"units": "s", "long_name": TIME_NAME}
    with netCDF4.Dataset(older) as dataset:
        assert data_sha256(dataset) == dataset.data_sha256
    assert lk.read_state(run_file).time == lk.read_state(older).time > 0.0


def test_runs_of_both_kinds_are_one_campaign(run_file, older):
    runs = lk.open_campaign(run_file, older)
    assert runs["time"].attrs["units"] == "s"
    np.testing.assert_array_equal(runs["time"][0], runs["time"][1])
    seconds = runs.runs.over(lambda records: {"end": (float(records["time"][-1]), records["time"].attrs["units"], "")})
    assert seconds["end"].attrs["units"] == "s" and seconds["end"][0] == seconds["end"][1] == runs["time"].max()


def test_a_tree_has_the_accessor_of_a_run(run_file, specimen_file):
    with lk.open_run(run_file) as run, xr.open_datatree(run_file) as tree:
        assert set(tree.children) >= {"contacts", "grains"}
        xr.testing.assert_identical(tree.lab.statistics(), run.lab.statistics())
        np.testing.assert_allclose(tree.lab.to_dataframe()["time"], run["time"], atol=1e-9)  # xarray's dates are in ns
        np.testing.assert_array_equal(lk.love_stress(tree.lab.snapshot(-1)), lk.love_stress(run.lab.snapshot(-1)))
    with xr.open_datatree(specimen_file) as tree, pytest.raises(lk.InputError, match="not a labkit run"):
        _ = tree.lab

"""State and run files follow CF 1.10; other programs open them with the attributes that CF asks for."""

import os
import shutil
import subprocess

import netCDF4
import numpy as np
import pytest
import xarray as xr

import labkit as lk
import labkit.runs.dataset  # registers the accessor of a tree
from labkit.dem.recorder import read_checkpoint

CHECKER = os.environ.get("LABKIT_CF_CHECKER") or shutil.which("compliance-checker")


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """A state file and a run file."""
    folder = tmp_path_factory.mktemp("cf")
    state = lk.make_specimen(
        lk.Recipe(void_ratio=0.67, grains=100), lk.Scene(), file=folder / "s.state.nc", progress=False
    )
    run = lk.run(state, lk.paths.ConstantVolume(strain=0.001), file=folder / "r.run.nc", progress=False)
    run.data.close()
    return folder / "s.state.nc", folder / "r.run.nc"


@pytest.mark.skipif(CHECKER is None, reason="compliance-checker is not installed: pip install compliance-checker")
def test_the_checker_accepts_state_and_run_files(files):
    for file in files:
        done = subprocess.run([CHECKER, "-t", "cf:1.10", "-c", "strict", file], capture_output=True, text=True)
        complaints = [line for line in done.stdout.splitlines() if line.startswith("*")]
        assert complaints == [] and "All tests passed" in done.stdout, done.stdout


def test_axes_time_and_titles_are_labelled(files):
    for file in files:
        with netCDF4.Dataset(file) as dataset:
            assert str(dataset.labkit_file) in dataset.title and dataset.Conventions == "CF-1.10"
            for group in (dataset, *dataset.groups.values()):
                assert not set(group.ncattrs()) & (set(group.variables) | set(dataset.variables))
                for name, variable in group.variables.items():
                    assert variable.units and variable.long_name, name
                    assert not {"featureType", "sample_dimension"} & set(variable.ncattrs())
            for axis in "ij":
                assert dataset[axis].flag_meanings.split() == ["x", "y", "z"]
                np.testing.assert_array_equal(dataset[axis][:], dataset[axis].flag_values)
    with netCDF4.Dataset(files[1]) as dataset:
        assert dataset["time"].standard_name == "time"


def test_the_time_of_a_checkpoint_is_read_from_files_of_any_version(files, tmp_path):
    state = read_checkpoint(files[1])
    assert state.time > 0.0
    older = shutil.copy(files[1], tmp_path / "older.run.nc")
    with netCDF4.Dataset(older, "a") as dataset:
        dataset.setncattr("time", dataset.checkpoint_time)
        dataset.delncattr("checkpoint_time")
    assert read_checkpoint(older).time == state.time


def test_a_tree_has_the_accessor_of_a_run(files):
    run = lk.open_run(files[1])
    with xr.open_datatree(files[1]) as tree:
        assert set(tree.children) >= {"contacts", "grains"}
        xr.testing.assert_identical(tree.lab.statistics(), run.lab.statistics())
        np.testing.assert_allclose(tree.lab.to_dataframe()["time"], run["time"], rtol=1e-6, atol=1e-9)
        love = lk.love_stress(tree.lab.snapshot(-1))
    np.testing.assert_array_equal(love, lk.love_stress(run.lab.snapshot(-1)))
    with xr.open_datatree(files[0]) as tree, pytest.raises(lk.InputError, match="not a labkit run"):
        _ = tree.lab

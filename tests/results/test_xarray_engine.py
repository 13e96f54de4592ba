"""Run files as an engine of xarray."""

import pytest
import xarray as xr

import labkit as lk


def test_xarray_finds_the_engine_and_opens_what_labkit_opens(run_file):
    ours = lk.open_run(run_file)
    with xr.open_dataset(run_file, engine="labkit") as theirs:
        xr.testing.assert_identical(theirs.load(), ours.load())
        assert theirs["stress"].sel(i="z", j="z").dims == ("time",)
    with xr.open_dataset(run_file, engine="labkit", drop_variables=["stress"]) as fewer:
        assert set(ours.variables) - set(fewer.variables) == {"stress"}


def test_a_file_that_is_no_run_is_refused_in_a_sentence(specimen_file):
    with pytest.raises(lk.InputError, match="run"):
        xr.open_dataset(specimen_file, engine="labkit")

"""The small study through the command line: killed, begun again, its data and its page."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray

from analysis.speed_error.design import small
from analysis.speed_error.observables import OBSERVABLES
from analysis.speed_error.table import collect, restore
from tests.analysis.conftest import in_the_clone


def start(folder):
    words = ["speed-error", "--design", "small", "--jobs", "2", "--work", folder / "work", "-o", folder / "out"]
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "analysis", *map(str, words)],
        env=in_the_clone(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def processes_with(text):
    found = []
    for number in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{number}/environ", "rb") as file:
                found += [number] if text.encode() in file.read() else []
        except OSError:
            pass
    return found


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A small study that was killed after its first results, and what was there then: name -> time of writing."""
    folder = tmp_path_factory.mktemp("study")
    os.environ["LABKIT_STUDY_OF_THE_TESTS"] = str(folder)
    child = start(folder)
    results = folder / "work" / "results"
    deadline = time.monotonic() + 300
    while not (results.exists() and len(list(results.glob("*.json"))) >= 5):
        assert child.poll() is None and time.monotonic() < deadline, child.stderr.read()
        time.sleep(0.05)
    child.send_signal(signal.SIGKILL)
    child.wait()
    time.sleep(0.5)
    assert processes_with(str(folder)) == [str(os.getpid())] or not processes_with(str(folder))
    kept = {file: file.stat().st_mtime_ns for file in results.glob("*.json")}
    child = start(folder)
    _out, error = child.communicate(timeout=500)
    assert child.returncode == 0, error
    return folder, kept


def test_a_study_that_was_killed_goes_on_and_repeats_nothing(study):
    _folder, kept = study
    assert 5 <= len(kept) < sum(len(case.seeds) for case in small().cases)
    assert {file: file.stat().st_mtime_ns for file in kept} == kept


def test_the_data_set_is_whole_and_labelled(study):
    data = xarray.open_dataset(study[0] / "out" / "study.nc")
    assert data.sizes["case"] == len(small().cases) and set(data["observable"].values) == set(OBSERVABLES)
    for name, variable in data.data_vars.items():
        assert variable.attrs["long_name"] and ("units" in variable.attrs), name
    run = data["seed"].values > 0
    said = data["status"].values.astype(str)
    assert (said[run] == "").all()
    values = data["value"].sel(observable="ratio_critical").values[run]
    assert np.isfinite(values).all()


def test_a_study_goes_on_from_the_data_set_of_another(study, tmp_path):
    data = xarray.open_dataset(study[0] / "out" / "study.nc")
    tests = sum(len(case.seeds) for case in small().cases)
    assert restore(data, small(), tmp_path) == tests and restore(data, small(), tmp_path) == 0
    again = collect(small(), tmp_path)
    for name in data.data_vars:
        np.testing.assert_array_equal(again[name].values, data[name].values, err_msg=name)


def test_a_file_that_is_no_study(study_command, run_file, tmp_path):
    for file, words in ((run_file, "is not a study"), (tmp_path / "none.nc", "cannot be read")):
        done = study_command("speed-error", "--design", "small", "--from", file, cwd=tmp_path)
        assert done.returncode == 2 and words in done.stderr and not list(tmp_path.iterdir())


def test_past_the_limit_the_balance_shows_it_and_below_it_does_not(study):
    data = xarray.open_dataset(study[0] / "out" / "study.nc").swap_dims(case="level")
    energy = data["check"].sel(check_name="energy_balance_error").max("replicate")
    assert float(energy.sel(level="1.2")) > 1.0 > 0.01 > float(energy.sel(level="0.1"))
    assert float(data["time_step_over_limit"].sel(level="1.2").min()) > 1.0


def test_both_engines_begin_alike(study):
    data = xarray.open_dataset(study[0] / "out" / "study.nc").swap_dims(case="level")
    value = data["value"].sel(observable="ratio_1").isel(replicate=0)
    assert float(value.sel(level="yade")) == pytest.approx(float(value.sel(level="fused")), rel=1e-6)


def test_the_page_has_all_sections_and_every_figure_that_it_shows(study):
    page = (study[0] / "out" / "README.md").read_text()
    for title in (
        "Recommended settings",
        "along CV",
        "One factor at a time",
        "The time step, through the limit",
        "How many grains",
        "Two grains",
        "stress-force-fabric family",
    ):
        assert title in page
    assert "nan" not in page
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", page):
        assert (study[0] / "out" / picture).stat().st_size > 10_000


def test_a_design_that_is_unknown(study_command, tmp_path):
    done = study_command("speed-error", "--design", "huge", cwd=tmp_path)
    assert done.returncode == 2 and "small" in done.stderr and not list(tmp_path.iterdir())

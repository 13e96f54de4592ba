"""The small study on the command line: interrupted, killed, resumed; its data and its page."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray

from analysis.speed_error.design import read_design
from analysis.speed_error.observables import OBSERVABLES
from analysis.speed_error.table import collect, restore
from tests.analysis.conftest import ROOT, in_the_clone
from tests.conftest import PATIENCE, wait_until

pytestmark = [pytest.mark.long, pytest.mark.yade]

RESULTS = 3  # results after which the study is killed


def words(folder):
    """The command of the small study."""
    folders = ["--work", str(folder / "work"), "-o", str(folder / "out")]
    return ["speed-error", "--design", "small", "--jobs", "2", *folders]


def start(folder):
    """The small study in its own process group, as a shell starts it."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "analysis", *words(folder)],
        env=in_the_clone(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def results(folder):
    return list((folder / "work" / "results").glob("*.json"))


def wait_for(study, folder, number):
    """Waits until a running study has written `number` results."""
    wait_until(lambda: len(results(folder)) >= number, study)


def wait_for_the_end(group):
    """Waits until no process of a group is left."""
    with contextlib.suppress(ProcessLookupError):
        wait_until(lambda: os.killpg(group, 0))


def interrupted(folder):
    """Starts a study and presses Ctrl-C twice after a result: (exit code, stderr) after all processes ended."""
    study = start(folder)
    wait_for(study, folder, 1)
    os.killpg(study.pid, signal.SIGINT)
    time.sleep(0.3)
    os.killpg(study.pid, signal.SIGINT)
    _, error = study.communicate(timeout=PATIENCE)
    wait_for_the_end(study.pid)
    return study.returncode, error


@pytest.fixture(scope="module")
def study(tmp_path_factory, study_command):
    """A small study that was interrupted, killed and resumed.

    Its folder, the outcome of the interruption, and the time at which each result before the kill was written.
    """
    folder = tmp_path_factory.mktemp("study")
    outcome = interrupted(folder)
    child = start(folder)
    wait_for(child, folder, RESULTS)
    child.send_signal(signal.SIGKILL)
    child.wait()
    wait_for_the_end(child.pid)
    kept = {file: file.stat().st_mtime_ns for file in results(folder)}
    done = study_command(*words(folder), cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return folder, outcome, kept


def test_ctrl_c_ends_a_study_with_one_line(study):
    """Also if it is pressed again while the workers end."""
    code, error = study[1]
    assert code in (130, -signal.SIGINT)  # a shell reports 130 for both
    lines = re.split("[\r\n]+", error)
    assert "Traceback" not in error
    assert [line for line in lines if "repeat the same command to resume" in line] == [lines[-2]] and lines[-1] == ""


def test_a_study_that_was_killed_goes_on_and_repeats_nothing(study):
    kept = study[2]
    assert RESULTS <= len(kept) < sum(len(case.seeds) for case in read_design("small").cases)
    assert {file: file.stat().st_mtime_ns for file in kept} == kept


def test_the_data_set_is_whole_and_labelled(study):
    data = xarray.open_dataset(study[0] / "out" / "study.nc")
    assert data.sizes["case"] == len(read_design("small").cases) and set(data["observable"].values) == set(OBSERVABLES)
    for name, variable in data.data_vars.items():
        assert variable.attrs["long_name"] and ("units" in variable.attrs), name
    run = data["seed"].values > 0
    status = data["status"].values.astype(str)
    assert (status[run] == "").all()
    values = data["value"].sel(observable="ratio_critical").values[run]
    assert np.isfinite(values).all()


def test_a_study_goes_on_from_the_data_set_of_another(study, tmp_path):
    data = xarray.open_dataset(study[0] / "out" / "study.nc")
    tests = sum(len(case.seeds) for case in read_design("small").cases)
    assert restore(data, read_design("small"), tmp_path) == tests and restore(data, read_design("small"), tmp_path) == 0
    again = collect(read_design("small"), tmp_path)
    for name in data.data_vars:
        np.testing.assert_array_equal(again[name].values, data[name].values, err_msg=name)


def test_a_file_that_is_no_study(study_command, run_file, tmp_path):
    for file, words in ((run_file, "is not a study file"), (tmp_path / "none.nc", "cannot be read")):
        done = study_command("speed-error", "--design", "small", "--from", file, cwd=tmp_path)
        assert done.returncode == 2 and words in done.stderr and not list(tmp_path.iterdir())


def test_past_the_limit_the_balance_shows_it_and_below_it_does_not(study):
    data = xarray.open_dataset(study[0] / "out" / "study.nc").swap_dims(case="level")
    energy = data["check"].sel(check_name="energy_balance_error").max("replicate")
    assert float(energy.sel(level="1.2")) > 1.0 > 0.01 > float(energy.sel(level="0.1"))
    assert float(data["time_step_over_limit"].sel(level="1.2").min()) > 1.0


def test_the_page_has_all_sections_and_every_figure_that_it_shows(study):
    page = (study[0] / "out" / "README.md").read_text()
    for title in (
        "Recommended settings",
        "in CV tests",
        "One factor at a time",
        "The time step below and above",
        "Number of grains",
        "Collisions of two grains",
        "stress-force-fabric family",
    ):
        assert title in page
    assert "nan" not in page
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", page):
        assert (study[0] / "out" / picture).stat().st_size > 10_000


def test_redraw_writes_the_same_page_from_the_data_alone(study, study_command, tmp_path):
    out = shutil.copytree(study[0] / "out", tmp_path / "out")
    page, errors = (out / "README.md").read_text(), (out / "errors.csv").read_text()
    for file in ("README.md", "errors.csv", "pareto_cp.png"):
        (out / file).unlink()
    done = study_command("speed-error", "--redraw", "-o", out, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (out / "README.md").read_text() == page and (out / "errors.csv").read_text() == errors
    assert (out / "pareto_cp.png").stat().st_size > 10_000
    assert [file.name for file in tmp_path.iterdir()] == ["out"]


def test_redraw_without_a_study(study_command, tmp_path):
    done = study_command("speed-error", "--redraw", "-o", tmp_path / "none", cwd=tmp_path)
    assert done.returncode == 2 and "contains no study.nc" in done.stderr and not list(tmp_path.iterdir())


def test_a_design_that_is_unknown(study_command, tmp_path):
    done = study_command("speed-error", "--design", "huge", cwd=tmp_path)
    assert done.returncode == 2 and "small" in done.stderr and not list(tmp_path.iterdir())

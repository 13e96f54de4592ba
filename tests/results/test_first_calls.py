"""Every public function that computes may be the first call of a process, alone and from four threads."""

import importlib
import inspect
import subprocess
import sys

import pytest

import labkit as lk
from tests.conftest import ROOT
from tests.results.first_calls import CALLS

# made of functions that are called first here: specimens and runs
COMPOSED = {"calibrate", "calibrate_grains", "density_limits", "specimen_at"}
COMPOSED |= {"compression_numbers", "critical_line"}  # of an oedometer, and of several critical states
# these read or write small texts, tables and files of other programs, or register names
NOT_COMPUTING = {
    "import_snapshot",
    "import_state",
    "misfit",
    "read_probes",
    "parameter",
    "read_measured",
    "read_path",
} | {
    *("register_engine", "register_figure", "register_format", "register_law", "register_path", "register_shape"),
    *("register_statistic", "use", "write_measured"),
}


def functions_of_a_snapshot(package):
    """The public functions of a package whose only required argument is a snapshot."""
    room = importlib.import_module(f"labkit.{package}")
    for name in room.__all__:
        function = getattr(room, name)
        if inspect.isfunction(function):
            arguments = inspect.signature(function).parameters.values()
            if [one.name for one in arguments if one.default is one.empty] == ["snapshot"]:
                yield f"{package}.{name}"


def test_no_public_function_is_forgotten():
    public = {name for name in lk.__all__ if inspect.isfunction(getattr(lk, name))}
    called = {name for name in CALLS if "." not in name and inspect.isfunction(getattr(lk, name))}
    assert public == called | COMPOSED | NOT_COMPUTING


@pytest.mark.slow
def test_every_public_function_may_be_the_first_call(loose_specimen, tmp_path):
    state, run = tmp_path / "s.state.nc", tmp_path / "r.run.nc"
    lk.write_state(state, loose_specimen)
    lk.run(loose_specimen, lk.paths.ConstantVolume(strain=1e-3), file=run, progress=False, snapshots=2)
    names = [*CALLS, *functions_of_a_snapshot("micro"), *functions_of_a_snapshot("sff")]
    words = [sys.executable, "-m", "tests.results.first_calls", state, run, tmp_path, *names]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "" and done.returncode == 0, done.stdout + done.stderr

"""Real YADE, real files: a small specimen and a small run are made once and shared by the tests."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples at every run, so that a failure is that of a change;
# `./lab test --hypothesis-profile search` looks for new ones.
settings.register_profile("repeat", derandomize=True, database=None)
settings.register_profile("search", derandomize=False)
settings.load_profile("repeat")

ROOT = Path(__file__).resolve().parents[1]


def run_labkit(*words, cwd=None, environment=None):
    """`labkit words` as a user runs it; the finished process with its output as text."""
    return subprocess.run(
        [sys.executable, "-m", "labkit.cli", *map(str, words)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )


@pytest.fixture(scope="session")
def labkit_command():
    return run_labkit


@pytest.fixture(scope="session")
def in_yade(tmp_path_factory):
    """Runs a script of tests/engines/in_yade inside YADE and returns the JSON that it writes."""

    def run(script, *words):
        output = tmp_path_factory.mktemp("in_yade") / "result.json"
        command = ["yade", "-n", "-x", ROOT / "tests/engines/in_yade" / script, ROOT, output, *words]
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(output.read_text())

    return run


@pytest.fixture(scope="session")
def specimen_file(tmp_path_factory):
    """A specimen of about 500 grains at e = 0.67."""
    path = tmp_path_factory.mktemp("specimen") / "small.state.nc"
    done = run_labkit("specimen", "--void-ratio", 0.67, "--grains", 500, "--seed", 3, "-o", path)
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="session")
def run_file(tmp_path_factory, specimen_file):
    """A CV test of the small specimen to 2 % axial strain."""
    path = tmp_path_factory.mktemp("run") / "small.run.nc"
    done = run_labkit("run", "cv", specimen_file, "--strain", 0.02, "--snapshots", 5, "-o", path)
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="session")
def soft_specimen():
    """About 200 grains of medium density at 100 kPa."""
    import labkit as lk

    recipe = lk.Recipe(void_ratio=0.66, grains=200)
    return lk.consolidate(lk.make_specimen(recipe, lk.Scene(), progress=False), 1e5, progress=False)


@pytest.fixture(scope="session")
def liquefied_file(tmp_path_factory, soft_specimen):
    """An undrained cyclic triaxial test of the soft specimen, which liquefies."""
    import labkit as lk

    file = tmp_path_factory.mktemp("liquefied") / "cycles.run.nc"
    path = lk.paths.UndrainedCycles(amplitude=40e3, cycles=40, rate=100.0)
    lk.run(soft_specimen, path, file=file, progress=False, snapshots=4, record_strain=4e-4)
    return file


@pytest.fixture(scope="session")
def shear_file(tmp_path_factory, soft_specimen):
    """A simple shear test of the soft specimen to gamma_xz = 0.2."""
    import labkit as lk

    file = tmp_path_factory.mktemp("sheared") / "shear.run.nc"
    path = lk.paths.SimpleShear(strain=0.2, rate=300.0)
    lk.run(soft_specimen, path, file=file, progress=False, snapshots=4, record_strain=4e-3)
    return file

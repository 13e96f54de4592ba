"""The disk fails at the n-th call, for many n: the old file stays, nothing else is left, the message has the name."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def failing_disk(tmp_path_factory):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("needs a C compiler and Linux")
    library = tmp_path_factory.mktemp("faults") / "faults.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", library, HERE / "faults.c", "-ldl"], check=True)
    return library


def test_every_failing_call_is_reported_and_leaves_the_file_as_it_was(failing_disk, specimen_file):
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # where fsync is instant
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        words = [sys.executable, HERE / "failing_disk.py", specimen_file, folder]
        environment = {**os.environ, "LD_PRELOAD": f"./{failing_disk.name}"}  # a blank would end a path
        done = subprocess.run(words, cwd=failing_disk.parent, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert {name: one["problems"] for name, one in found.items()} == {name: [] for name in found}
    assert all(one["failures"] >= 2 for one in found.values()), found
    # HDF5 crashes if its very last call fails, which rewrites 48 bytes; even then the previous file survives
    assert all(one["crashes"] <= 1 for one in found.values()), found


def test_disk_space_is_asked_for_only_if_it_is_missing(specimen_file, tmp_path):
    """Here a limit of the process ends the file."""
    program = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)); "
    program += "from labkit.cli import program; raise SystemExit(program())"
    words = [sys.executable, "-c", program, "run", "cv", specimen_file, "--strain", "0.001", "-o", "r.run.nc"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1 and "File too large" in done.stderr, done.stderr
    assert done.stderr.splitlines()[-1].endswith("; there is no earlier save: give the same command again")

"""File systems without locks, as on some clusters: labkit works there and says what it cannot prevent."""

import errno
import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from labkit.process.interruption import is_being_written, lock_of, only_writer
from tests.conftest import ROOT

HERE = Path(__file__).parent
PROGRAM = """
import sys
from pathlib import Path
import labkit as lk
from labkit.process.interruption import only_writer

state_file, new = sys.argv[1:]
state = lk.read_state(state_file)
with only_writer(Path(new)):
    lk.write_state(new, state)
print(lk.read_state(new).digest() == state.digest())
"""


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP])
def test_a_file_without_a_lock_is_written(number, tmp_path, monkeypatch, capsys):
    def refuse(*_):
        raise OSError(number, os.strerror(number))

    file = tmp_path / "a.state.nc"
    monkeypatch.setattr(fcntl, "flock", refuse)
    for _ in range(2):
        with only_writer(file):
            assert not is_being_written(file)
    said = "is on a file system without locks: two processes could write it, and one result would be lost"
    assert capsys.readouterr().err == f"labkit: {file} {said}\n" and not lock_of(file).exists()


@pytest.mark.slow
@pytest.mark.parametrize("setting", [None, "FALSE"])
def test_hdf5_opens_files_without_locks(setting, specimen_file, tmp_path):
    """A command opens them by itself. In a user's process, the message says how to."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("needs a C compiler and Linux")
    library = tmp_path / "no_locks.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, HERE / "no_locks.c", "-ldl"], check=True)
    environment = {name: value for name, value in os.environ.items() if name != "HDF5_USE_FILE_LOCKING"}
    environment |= {"LD_PRELOAD": str(library)} | ({} if setting is None else {"HDF5_USE_FILE_LOCKING": setting})

    def start(*words):
        return subprocess.run([sys.executable, *words], env=environment, cwd=ROOT, capture_output=True, text=True)

    done = start("-c", PROGRAM, specimen_file, tmp_path / "new.state.nc")
    if setting == "FALSE" or done.returncode == 0:
        assert done.stdout == "True\n", done.stderr
    else:
        assert "; if its file system has no locks, set HDF5_USE_FILE_LOCKING=FALSE" in done.stderr
    words = ("--law", "bonded", "--bond-strength", "2MPa", "--bond-shear-strength", "2MPa")
    done = start("-m", "labkit", "bond", specimen_file, *words, "-o", tmp_path / "bonded.state.nc")
    assert done.returncode == 0, done.stderr

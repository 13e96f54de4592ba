"""labkit makes a specimen, a run and files where the modules and functions of Linux alone are missing."""

import subprocess
import sys

import pytest

import labkit as lk

pytestmark = pytest.mark.slow

PROGRAM = """
import os, signal, sys
sys.modules["fcntl"] = sys.modules["resource"] = None  # importing them raises ImportError
for name in ("sched_getaffinity", "posix_fallocate", "getloadavg", "fork", "O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK"):
    delattr(os, name)
del signal.SIGHUP
import labkit as lk
scene = lk.Scene()
state = lk.make_specimen(lk.Recipe(0.64, grains=150), scene, file="s.state.nc", progress=False)
path = lk.paths.ConstantVolume(strain=0.005, rate=100)
run = lk.run(lk.read_state("s.state.nc"), path, file="r.run.nc", progress=False)
assert run.complete and lk.Run.open("r.run.nc").complete
[outcome] = lk.run_many([(state, path)], progress=False)
print(outcome.run.data.attrs["data_sha256"], run.data.attrs["data_sha256"])
"""


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_without_locks_affinity_and_resource_limits(tmp_path):
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    state = lk.read_state(tmp_path / "s.state.nc")
    here = lk.run(state, lk.paths.ConstantVolume(strain=0.005, rate=100), progress=False)
    assert done.stdout.split() == [here.data.attrs["data_sha256"]] * 2
    assert "without locks" in done.stderr

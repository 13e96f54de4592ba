"""The fused engine on MPI ranks: the bits of one thread, and the end of ranks that are killed or cannot start."""

import gc
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import weakref

import numpy as np
import pytest

import labkit as lk
from benchmarks.ranks import differences
from labkit.engines import followers, mpi
from labkit.engines.fused import FusedEngine
from labkit.errors import InputError
from tests.conftest import PATIENCE, ROOT, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.mpi]

SMALL_DOMAINS = """\
import labkit.process.system
labkit.process.system.number_of_cores = lambda: 8
import labkit.engines.kernel.packing
labkit.engines.kernel.packing.GRAINS_PER_DOMAIN = 64
"""  # Python executes it at the start of each rank: a small specimen then has domains for four


@pytest.fixture(scope="module")
def small_domains(tmp_path_factory):
    """The environment of processes in which a few hundred grains have several domains."""
    pytest.importorskip("mpi4py", reason="needs MPI: the extra `lammps`")
    vendor = subprocess.run(
        [sys.executable, "-c", "from mpi4py import MPI; print(MPI.get_vendor()[0])"], capture_output=True, text=True
    )
    if vendor.stdout.strip() != "MPICH":
        pytest.skip(f"needs MPICH, not {vendor.stdout.strip() or vendor.stderr[-80:]}")
    folder = tmp_path_factory.mktemp("ranks")
    (folder / "sitecustomize.py").write_text(SMALL_DOMAINS)
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (folder, ROOT)))}


@pytest.fixture
def specimen(tmp_path):
    file = tmp_path / "s.state.nc"
    lk.write_state(file, lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=260), progress=False))
    return file


def command(specimen, output, *more):
    words = ("run", "cp", specimen, "--pressure", "500kPa", "--strain", 0.004, "--record-strain", 0.0002)
    return [
        *map(str, (sys.executable, "-m", "labkit.cli", *words, "--rate", 25, "--save-every", 1, "-o", output, *more))
    ]


def followers_of(process):
    """Numbers of the processes that a process has started, their children included."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True).stdout
    rows = [line.split(None, 2) for line in listed.splitlines()]
    found = {str(process.pid)}
    for number, parent, _ in rows:  # a child has a higher number than its parent, or the list is read again
        found |= {number} if parent in found else set()
    return [int(number) for number, _, words in rows if number in found and "-m labkit.engines.followers" in words]


def test_every_law_has_the_bits_of_one_thread(specimen, small_domains, tmp_path):
    """On 2, 3, 4 ranks and 2 ranks of 2 threads, at constant volume and p, in simple shear, in undrained cycles."""
    words = [sys.executable, "-m", "benchmarks.ranks", specimen, tmp_path / "t.csv", "--some", "--steps", "120"]
    done = subprocess.run(words, cwd=ROOT, env=small_domains, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    laws = len(lk.grains.laws.LAWS)
    assert done.stdout == f"{laws} of {laws} runs have all variables equal\n"


@pytest.mark.parametrize("victim", ["run", "follower", "launcher"])
def test_no_process_is_left_and_the_run_is_resumed_on_other_ranks(victim, specimen, small_domains, tmp_path):
    file, one = tmp_path / "r.run.nc", tmp_path / "one.run.nc"
    words = command(specimen, file, "--ranks", 3)
    run = subprocess.Popen(words, env=small_domains, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    wait_until(file.exists, run)
    ranks = followers_of(run)
    assert len(ranks) >= 2
    os.kill({"run": run.pid, "follower": ranks[-1], "launcher": ranks[0]}[victim], signal.SIGKILL)
    said = run.communicate(timeout=PATIENCE)[1]
    wait_until(lambda: not any(os.path.exists(f"/proc/{number}") for number in ranks))
    if victim != "run":
        assert run.returncode == 1 and "the other ranks ended" in said and "to resume" in said, said
    for ranks, output in ((2, file), (1, one)):
        again = subprocess.run(
            command(specimen, output, "--ranks", ranks), env=small_domains, capture_output=True, text=True
        )
        assert again.returncode == 0, again.stderr
    assert differences(one, file)[1] == []


def test_mpi_starts_in_spite_of_what_a_killed_process_of_the_same_number_left(small_domains):
    start = "from labkit.engines.mpi import mpi_library; print(mpi_library().COMM_WORLD.size)"
    words = ["sh", "-c", f"printf left > /dev/shm/mpich_shm_$(printf %x $$)_0; exec {sys.executable} -c '{start}'"]
    done = subprocess.run(words, env=small_domains, capture_output=True, text=True, timeout=PATIENCE)
    assert done.stdout == "1\n", done.stderr


LIMITED = """\
import resource, signal, sys
from labkit.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, 2 * (300_000,))
sys.exit(main(sys.argv[1:]))
"""  # a command on a full disk, of which `/dev/shm` is one


@pytest.mark.parametrize("engine", ["fused", "lammps"])
def test_ranks_without_memory_to_share_are_refused_before_mpi_ends_the_process(
    engine, specimen, small_domains, tmp_path
):
    words = [*command(specimen, tmp_path / "r.run.nc", "--ranks", 2, "--engine", engine)[3:]]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, *words], env=small_domains, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 2 and "MPI needs 5 MB of memory in /dev/shm" in done.stderr, done.stderr
    assert done.stderr.count("\n") == 1 and os.listdir(tmp_path) == [specimen.name]


BROKEN = """\
import sys
if "labkit.engines.followers" in sys.orig_argv:
    import labkit.engines.kernel.exchange as exchange
    counted = iter(range(10**9))
    moved = exchange.Exchange.moved
    def moved_and_broken(self):
        if next(counted) == 20:
            raise MemoryError("no room")
        moved(self)
    exchange.Exchange.moved = moved_and_broken
"""  # what Python executes at the start of each rank, for an error on a follower alone


def test_an_error_on_one_rank_ends_the_run_with_its_sentence(specimen, small_domains, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(SMALL_DOMAINS + BROKEN)
    environment = {**small_domains, "PYTHONPATH": os.pathsep.join(map(str, (tmp_path, ROOT)))}
    words = command(specimen, tmp_path / "r.run.nc", "--ranks", 2)
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 1, done.stderr
    assert "rank 1: MemoryError: no room; give the same command to resume a run" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize("on_ranks", [False, True])
def test_a_search_frees_the_arrays_before_it_allocates_new_ones(on_ranks, specimen, small_domains):
    left = []

    class Searching(FusedEngine):
        def _free(self):
            before = self._packing and weakref.ref(self._packing.arrays.blocks)
            super()._free()
            left.append(before and before())

    gc.disable()
    try:
        engine = Searching(lk.read_state(specimen), ranks=followers.alone() if on_ranks else None)
        engine.advance(400, np.diag([500.0, 500.0, -1000.0]))
    finally:
        gc.enable()
    assert len(left) > 1 and left == [None] * len(left)


@pytest.mark.parametrize("stopped", ["follower", "launcher"])
def test_a_stopped_process_does_not_outlive_a_killed_run(stopped, specimen, small_domains, tmp_path):
    file = tmp_path / "r.run.nc"
    run = subprocess.Popen(command(specimen, file, "--ranks", 2), env=small_domains, cwd=tmp_path)
    wait_until(file.exists, run)
    ranks = followers_of(run)
    os.kill({"follower": ranks[-1], "launcher": ranks[0]}[stopped], signal.SIGSTOP)
    run.kill()
    run.wait()
    wait_until(lambda: not any(os.path.exists(f"/proc/{number}") for number in ranks))


COMPILES_NOTHING = """\
import sys
if "labkit.engines.followers" in sys.orig_argv:
    import labkit.engines.kernel.machine as machine
    del machine.compile_code
"""


def test_all_ranks_execute_the_code_of_the_first_even_if_no_file_can_keep_it(specimen, small_domains, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(SMALL_DOMAINS + COMPILES_NOTHING)
    nowhere = str(tmp_path / "sitecustomize.py" / "folder")
    path = os.pathsep.join(map(str, (tmp_path, ROOT)))
    environment = {**small_domains, "PYTHONPATH": path, "NUMBA_CACHE_DIR": nowhere}
    words = command(specimen, tmp_path / "r.run.nc", "--ranks", 2)
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_ranks_at_a_checkpoint(number, specimen, small_domains, tmp_path):
    file = tmp_path / "r.run.nc"
    words = command(specimen, file, "--ranks", 2)
    run = subprocess.Popen(words, env=small_domains, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    wait_until(file.exists, run)
    ranks = followers_of(run)
    for process in (*ranks, run.pid):  # as Ctrl-C in a terminal, or `scancel`, for all of them
        os.kill(process, number)
    said = run.communicate(timeout=PATIENCE)[1]
    assert run.returncode == 128 + number, said
    wait_until(lambda: not any(os.path.exists(f"/proc/{number}") for number in ranks))


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names a processor of this kind")
def test_processors_with_other_code_are_told_apart(specimen, small_domains, tmp_path):
    launcher = shutil.which(mpi.LOCAL) or shutil.which("mpiexec")
    other = shlex.join(["env", "NUMBA_CPU_NAME=x86-64-v3", "NUMBA_CPU_FEATURES=", launcher])
    environment = {**small_domains, mpi.LAUNCHER: other}
    words = command(specimen, tmp_path / "r.run.nc", "--ranks", 2)
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 2 and "the processors on" in done.stderr, done.stderr
    assert not (tmp_path / "r.run.nc").exists()


@pytest.mark.parametrize(
    ("ranks", "threads", "problem"),
    [(9, 1, "too many for this computer: give at most 8"), (3, 3, "threads are too many here: give at most 2"),
     (5, 1, "too many for these grains: give at most 4")],
)  # fmt: skip
def test_more_ranks_than_cores_or_domains_are_refused(ranks, threads, problem, specimen, small_domains, tmp_path):
    words = command(specimen, tmp_path / "r.run.nc", "--ranks", ranks, "--threads", threads)
    done = subprocess.run(words, env=small_domains, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 2 and f"--ranks {ranks}" in done.stderr and problem in done.stderr, done.stderr
    assert len(done.stderr.strip().splitlines()) <= 2 and not (tmp_path / "r.run.nc").exists()


def test_without_mpi4py_the_user_is_told_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    monkeypatch.setenv("UCX_TLS", "shm,self")
    with pytest.raises(InputError, match=r"MPI ranks need mpi4py: .* -m pip install "):
        mpi.mpi_library()


def test_without_mpiexec_the_user_is_told_what_to_install(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    monkeypatch.delenv(mpi.LAUNCHER, raising=False)
    with pytest.raises(InputError, match=r"mpiexec is not on the PATH: install it with .* pip install "):
        mpi.launcher()


def test_clumps_are_refused_on_ranks():
    with pytest.raises(InputError, match=r"ranks 2 cannot share clumps.*give threads instead"):
        lk.Fused(ranks=2).require_grains(clumps=True)


@pytest.mark.parametrize("wrong", [0, -1, 1.5, "2", True])
def test_a_number_of_ranks_is_a_whole_number(wrong):
    with pytest.raises(InputError, match=r"^ranks .*whole number of at least 1"):
        lk.Fused(ranks=wrong)

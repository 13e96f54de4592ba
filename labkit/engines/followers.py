"""Engines on MPI ranks: rank 0 is the process of the run; the others, its followers, repeat the calls of its engine.

Rank 0 starts the followers with `mpiexec -n N python -P -m labkit.engines.followers PORT`, and connects to them by MPI.
Every rank then has an engine of the same class, and rank 0 tells the followers each call before it makes the call
itself (OnRanks). Signals and the clock concern rank 0 alone. The followers end with rank 0, whose end closes their
input. If a follower ends or has an error, the run ends with a one-line error and can be resumed.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import hashlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, TypeVar, cast

import numpy as np

from labkit.engines.base import Engine
from labkit.engines.mpi import LAUNCHER, MEMORY, launcher, mpi_library, require_shared_memory
from labkit.engines.server import ENDING, RESUME, SILENCE, last_line, printed, start_process, wait_for_program
from labkit.errors import InputError, PhysicsError, ProgramError, fail
from labkit.grains.state import State
from labkit.process.children import die_with_parent, without_current_folder
from labkit.process.interruption import ending_signals
from labkit.process.system import number_of_cores
from labkit.version import __version__

LARGE = 500_000  # bytes
ROOT = Path(__file__).resolve().parents[2]
READY = "labkit: ready"  # what a follower prints before it connects
ERROR = 1  # tag of the message with the error of a follower
MAKE, END = "make", "end"  # what rank 0 tells besides the names of methods
SPINS, YIELDS = 200, 2000  # how often a rank looks for a message before it lets others run, and before it sleeps
NAP = 1e-4  # s; a rank that waits for long keeps no core busy
Shared = TypeVar("Shared")


def return_freed_memory() -> None:
    """Let glibc return freed arrays that are LARGE to the system at once, instead of keeping them for later ones."""
    with contextlib.suppress(OSError, AttributeError):  # another system, another library
        ctypes.CDLL(None).mallopt(-3, LARGE)  # M_MMAP_THRESHOLD


class Ranks:
    """All ranks of an engine, as one of them sees them: `rank` is its number, `size` the number of all.

    Args:
        comm: Communicator of mpi4py; its rank 0 is the process of the run.
        process: Launcher of the followers; None on a follower.
        output: What the followers print.
    """

    def __init__(
        self, comm: Any, process: subprocess.Popen[bytes] | None = None, output: IO[bytes] | None = None
    ) -> None:
        """Watch the followers, if this is rank 0."""
        self.comm, self.rank, self.size = comm, comm.rank, comm.size
        self._test = mpi_library().Request.Testall
        return_freed_memory()
        self._process, self._output, self._owner, self.over = process, output, os.getpid(), process is None
        if process is not None:
            _OPEN.add(self)
            threading.Thread(target=self._watch, daemon=True).start()

    def wait(self, *requests: Any) -> None:
        """Wait for MPI requests. On rank 0, raises the error of a follower, or ProgramError if the followers ended."""
        looks = 0
        while not self._test(requests):
            looks += 1
            if looks > SPINS:
                self._look_for_errors()
                time.sleep(NAP if looks > YIELDS else 0.0)

    def _look_for_errors(self) -> None:
        if self._process is None:
            return
        if self.comm.Iprobe(tag=ERROR):
            raise self.comm.recv(tag=ERROR)
        if self._process.poll() is not None:
            raise _ending(self._process, self._output)

    def share(self, make: Callable[[], Shared]) -> Shared:
        """Return on all ranks what `make` returns on rank 0."""
        if self.rank > 0:
            return cast("Shared", self.hear()[1][0])
        value = make()
        self.tell("", value)
        return value

    def require_same(self, code: bytes, what: str) -> None:
        """Raise InputError on all ranks if `code` is not the same on all; `what` says what it is."""
        row = hashlib.sha256(code).digest() + socket.gethostname().encode()[:32].ljust(32, b"\0")
        rows = np.zeros((self.size, 64), np.uint8)
        self.wait(self.comm.Iallgather(np.frombuffer(row, np.uint8), rows))
        differs = (rows[:, :32] != rows[0, :32]).any(axis=1)
        if differs.any():
            hosts = [bytes(rows[k, 32:]).rstrip(b"\0").decode(errors="replace") for k in (0, int(differs.argmax()))]
            raise InputError(f"{what} on {hosts[0]} and {hosts[1]} differ: use one labkit, on processors of one kind")

    def tell(self, name: str, *arguments: object) -> None:
        """Tell the followers the next call. Raises ProgramError if they have ended."""
        if self.over:
            raise ProgramError(f"the other ranks have ended; {RESUME}")
        buffers: list[pickle.PickleBuffer] = []
        content = pickle.dumps((name, arguments), 5, buffer_callback=buffers.append)
        arrays = [np.frombuffer(buffer.raw(), np.uint8) for buffer in buffers]
        head = np.frombuffer(pickle.dumps((content, [array.nbytes for array in arrays])), np.uint8)
        for array in (np.array([len(head)]), head, *arrays):
            self.wait(self.comm.Ibcast(array))

    def hear(self) -> tuple[str, tuple[Any, ...]]:
        """Return the next call of rank 0, name and arguments, on a follower."""
        size = np.zeros(1, int)
        self.wait(self.comm.Ibcast(size))
        head = np.empty(size[0], np.uint8)
        self.wait(self.comm.Ibcast(head))
        content, sizes = pickle.loads(head.tobytes())
        arrays = [np.empty(count, np.uint8) for count in sizes]
        for array in arrays:
            self.wait(self.comm.Ibcast(array))
        name, arguments = pickle.loads(content, buffers=arrays)
        return name, arguments

    def report(self, error: Exception) -> None:
        """Send an error to rank 0, which then ends this follower."""
        if not isinstance(error, (InputError, PhysicsError)):
            error = ProgramError(f"rank {self.rank}: {type(error).__name__}: {error}; {RESUME}")
        print(error, file=sys.stderr, flush=True)
        self.wait(self.comm.isend(error, 0, ERROR))
        time.sleep(2.0 * ENDING)  # rank 0 may wait inside another library, and see no message
        os._exit(1)

    def close(self) -> None:
        """End the followers, as they wait for the next call."""
        if self.over or self._owner != os.getpid():  # the second in a forked process
            return
        try:
            self.tell(END)
            self.comm.Disconnect()
            self._wait_for_end()  # MPI then removes the memory that the ranks share
            self._end()
        except PhysicsError:
            self.abandon()

    def abandon(self) -> None:
        """End the followers, whatever they do. MPI is then not closed, because it would wait for them."""
        if not self.over:
            atexit.unregister(_finalize)
            self._end()

    def _end(self) -> None:
        """Close the standard input of the followers, which ends them, and kill their launcher if it stays."""
        self.over = True
        _OPEN.discard(self)
        assert self._process is not None and self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        if not self._wait_for_end():
            self._process.kill()
            self._process.wait()

    def _wait_for_end(self) -> bool:
        """Wait for the end of the launcher, at most ENDING; return whether it has ended."""
        assert self._process is not None
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(ENDING)
        return self._process.poll() is not None

    def _watch(self) -> None:
        """End this process if the followers end while it waits for them inside another library."""
        assert self._process is not None
        self._process.wait()
        time.sleep(ENDING)
        if not self.over:
            os._exit(fail(_ending(self._process, self._output), 1))


_OPEN: set[Ranks] = set()  # ranks whose followers run


def _finalize() -> None:
    """End all followers and close MPI, as this process ends."""
    for ranks in list(_OPEN):
        ranks.close()
    if not mpi_library().Is_finalized():
        mpi_library().Finalize()


def _ending(process: subprocess.Popen[bytes], output: IO[bytes] | None) -> ProgramError:
    """Return the error that says how the followers ended."""
    said = last_line(output).replace(f", its last line: {READY}", "")
    return ProgramError(f"the other ranks ended with exit status {process.returncode}{said}; {RESUME}")


def alone() -> Ranks:
    """Return the ranks of an engine without followers."""
    return Ranks(mpi_library().COMM_SELF)


def start_followers(size: int, threads: int) -> Ranks:
    """Return `size` ranks of `threads` threads each: this process and the followers that it starts.

    Raises InputError for too many ranks or without MPI, ProgramError if the followers end at once, PhysicsError if they
    do not start in time, and Interrupted after a signal.
    """
    command, cores = launcher(), number_of_cores()
    if LAUNCHER not in os.environ and size * threads > cores:
        problem = "are too many for this computer" if threads == 1 else f"of {threads} threads are too many here"
        raise InputError(problem, field="ranks", value=size, allowed=f"at most {max(cores // threads, 1)}")
    mpi = mpi_library()
    if not os.environ.get(LAUNCHER):
        require_shared_memory(size)
    if mpi.COMM_WORLD.size > 1:
        raise InputError("start labkit without mpiexec: it starts the ranks itself")
    output, port = tempfile.TemporaryFile(), mpi.Open_port()
    memory = {} if os.environ.get(LAUNCHER) else MEMORY
    environment = {**memory, **without_current_folder(os.environ, str(ROOT)), "OMP_NUM_THREADS": "1"}
    program = [sys.executable, "-P", "-m", "labkit.engines.followers", port.encode().hex()]
    # in another folder, because MPI reads settings from the current one
    process = start_process(
        [*command, "-n", str(size - 1), *program], env=environment, cwd="/", stdin=subprocess.PIPE, stdout=output
    )

    def hear() -> None:
        if process.poll() is not None:
            raise _ending(process, output)
        if READY not in printed(output):
            time.sleep(0.02)
            raise TimeoutError

    try:
        wait_for_program("the other ranks", SILENCE, hear)
        connection = mpi.COMM_SELF.Accept(port)
    except BaseException as error:
        process.kill()
        process.wait()
        if not isinstance(error, mpi.Exception):
            raise
        raise InputError(f"the MPI library {mpi.get_vendor()[0]} does not connect programs: use MPICH") from None
    ranks = _join(connection, process, output)
    mpi.Close_port(port)
    atexit.register(_finalize)
    if ranks.size != size:
        ranks.abandon()
        raise InputError(
            f"{command[0]} does not start ranks of the MPI of labkit: name in {LAUNCHER} a launcher that does"
        )
    ranks.require_same(__version__.encode(), "the versions of labkit")
    return ranks


def _join(connection: Any, *of_first: Any) -> Ranks:
    """Return all ranks on the two sides of a connection."""
    comm = connection.Merge(high=not of_first)
    connection.Disconnect()
    return Ranks(comm, *of_first)


def make_engine(
    ranks: Ranks, state: State, kind: Callable[..., Engine], threads: int, options: dict[str, object]
) -> Engine:
    """Return the engine of this rank with a state loaded; the other arguments are those of OnRanks."""
    return kind(state, threads, ranks=ranks, **options)


def repeat_calls(port: str) -> None:
    """Repeat the calls of rank 0, which listens at the port, until it ends."""
    die_with_parent()
    for number in (signal.SIGINT, *ending_signals()):
        signal.signal(number, signal.SIG_IGN)
    mpi = mpi_library()
    if mpi.COMM_WORLD.rank == 0:
        threading.Thread(target=_end_with_input, daemon=True).start()
        print(READY, flush=True)
    ranks = _join(mpi.COMM_WORLD.Connect(port))
    try:
        ranks.require_same(__version__.encode(), "the versions of labkit")
        engine: Engine | None = None
        while (call := ranks.hear())[0] != END:
            name, arguments = call
            if name == MAKE:
                engine = make_engine(ranks, *arguments)
            else:
                getattr(engine, name)(*arguments)
    except Exception as error:
        ranks.report(error)
    ranks.comm.Disconnect()
    mpi.Finalize()


def _end_with_input() -> None:
    """End this process as soon as rank 0 has ended; the launcher then ends the other followers."""
    sys.stdin.buffer.read()
    os._exit(1)


if __name__ == "__main__":
    repeat_calls(bytes.fromhex(sys.argv[1]).decode())

"""Engines whose grains are in another process, the server, as YADE.

The run, its records and checkpoints stay in this process. If a server dies, hangs or uses a different version of the
messages, the run ends with a one-line error and can be resumed. An idle server is reused by the next engine of the same
kind. It ends with this process, because its socket is then closed.

A message between the two processes is a name, plain values and named arrays:

    4 bytes    length of the header, little-endian
    header     JSON {"name": "advance", "values": {"steps": 10}, "arrays": [["velocity_gradient", "<f8", [3, 3]]]}
    arrays     the bytes of each array of the header, in C order

yade_scripts/server.py, which may not import labkit, has the same two functions and the list of all messages.
"""

from __future__ import annotations

import abc
import contextlib
import json
import math
import os
import re
import signal
import socket
import struct
import subprocess
import time
import weakref
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from labkit.engines.base import Engine
from labkit.engines.sorting import sort_contacts
from labkit.errors import Interrupted, PhysicsError, ProgramError
from labkit.files.schema import STATE
from labkit.grains.columns import history_fields
from labkit.grains.state import State
from labkit.process.children import start_child
from labkit.process.interruption import ending_signals, signal_caught

PROTOCOL = 2  # incremented when messages change; must be equal in both processes
START = 60.0  # longest wait for the greeting (s)
SILENCE = 600.0  # longest wait for an answer (s); in a long `advance` the server reports every 10 s that it is alive
RESUME = "give the same command to resume a run"


Result = TypeVar("Result")
Values: TypeAlias = dict[str, Any]  # plain values, as in JSON


class Message(NamedTuple):
    """A message in either direction."""

    name: str
    values: Values
    arrays: Mapping[str, np.ndarray]


def send(peer: socket.socket, message: Message) -> None:
    """Send a message. Raises OSError if the other side has ended."""
    arrays = {name: np.asarray(array) for name, array in message.arrays.items()}
    listed = [(name, array.dtype.str, array.shape) for name, array in arrays.items()]
    header = json.dumps({"name": message.name, "values": message.values, "arrays": listed}).encode()
    peer.sendall(b"".join([struct.pack("<I", len(header)), header, *(array.tobytes() for array in arrays.values())]))


def receive(peer: socket.socket) -> Message:
    """Return the next message. Raises EOFError if the other side has ended, TimeoutError after the time limit."""
    header = json.loads(_read(peer, *struct.unpack("<I", _read(peer, 4))))
    arrays = {}
    for name, code, shape in header["arrays"]:
        kind = np.dtype(code)
        arrays[name] = np.frombuffer(_read(peer, kind.itemsize * math.prod(shape)), kind).reshape(shape)
    return Message(header["name"], header["values"], arrays)


def _read(peer: socket.socket, size: int) -> bytearray:
    content = bytearray(size)
    view = memoryview(content)
    while view:
        count = peer.recv_into(view)
        if not count:
            raise EOFError
        view = view[count:]
    return content


def start_process(command: Sequence[str], **options: Any) -> subprocess.Popen[bytes]:
    """Start the program of a server, which no signal ends: this process decides how to stop.

    The program inherits blocked signals, because a signal could come before the program can ignore it.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, *ending_signals()))
    try:
        return start_child(command, stderr=subprocess.STDOUT, start_new_session=True, **options)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def wait_for_program(program: str, limit: float, hear: Callable[[], Result]) -> Result:
    """Return the result of `hear`, which is repeated for at most `limit` s as long as it raises TimeoutError.

    Raises PhysicsError after the limit, and Interrupted if a signal is noted.
    """
    end = time.monotonic() + limit
    while not (number := signal_caught()):
        with contextlib.suppress(TimeoutError):
            return hear()
        if time.monotonic() > end:
            raise PhysicsError(
                f"{program} did not start within {limit:g} s: start it by hand, in the same environment, to see why"
            )
    raise Interrupted(f"stopped by signal {number} while {program} started: give the same command again", 128 + number)


def printed(output: IO[bytes] | None) -> str:
    """Return what a program has printed, without moving the place at which it prints."""
    content = b"" if output is None else os.pread(output.fileno(), os.fstat(output.fileno()).st_size, 0)
    return content.decode(errors="replace")


def last_line(output: IO[bytes] | None) -> str:
    """Return the words that tell the last line that a program printed, or nothing."""
    lines = [line.strip() for line in printed(output).splitlines() if re.search(r"\w", line)]
    telling = [line for line in lines if "EXIT STRING" in line] or lines  # MPICH's output ends with advice
    return f", its last line: {telling[-1]}" if telling else ""


class Server:
    """A program that serves an engine over a socket.

    Args:
        program: Name of the program, for messages.
        peer: Socket to the program.
        process: The process of the program; None if the program itself started this process.
        output: Standard output and errors of the program; None if they are not redirected.
    """

    def __init__(
        self,
        program: str,
        peer: socket.socket,
        process: subprocess.Popen[bytes] | None = None,
        output: IO[bytes] | None = None,
    ) -> None:
        """Wait for the greeting.

        Raises PhysicsError if there is none or if it has a different version, and Interrupted after a signal.
        """
        self.program, self.peer, self.process, self._output = program, peer, process, output
        self._owner, self._waits = os.getpid(), False
        peer.settimeout(0.1)
        try:
            wait_for_program(program, START, lambda: peer.recv(1, socket.MSG_PEEK))
        except (PhysicsError, Interrupted):
            self.close()
            raise
        except OSError:  # raised again by `receive`
            pass
        peer.settimeout(SILENCE)
        hello = self._guard("start", lambda: receive(self.peer))
        spoken = hello.values.get("protocol")
        if hello.name != "hello" or spoken != PROTOCOL:
            self.close()
            raise PhysicsError(
                f"the server in {program} speaks version {spoken} of labkit's messages, labkit {PROTOCOL}: use the "
                "scripts of this installation of labkit"
            )
        self.version, self.processors = str(hello.values["version"]), int(hello.values["threads"])

    def ask(self, name: str, values: Values | None = None, **arrays: np.ndarray) -> Message:
        """Return the answer to a message. Raises PhysicsError if the server reports an error, dies or hangs."""
        return self._guard(name, lambda: self._exchange(Message(name, values or {}, arrays)))

    def _exchange(self, message: Message) -> Message:
        send(self.peer, message)
        while (answer := receive(self.peer)).name == "alive":
            pass
        if answer.name == "error":
            raise PhysicsError(answer.values["text"])
        return answer

    def _guard(self, doing: str, work: Callable[[], Message]) -> Message:
        """Return the result of `work`, an exchange of messages; after an interruption the server is not usable."""
        self._waits = False
        try:
            answer = work()
            self._waits = True
            return answer
        except PhysicsError:
            self._waits = True
            raise
        except TimeoutError:
            self.close()
            raise ProgramError(
                f"{self.program} has not answered for {self.peer.gettimeout() or 0.0:g} s ({doing}); {RESUME}"
            ) from None
        except (EOFError, OSError):
            raise ProgramError(f"{self.program} {self._end()} ({doing}); {RESUME}") from None
        except BaseException:  # a signal
            self.close()
            raise

    def _end(self) -> str:
        """Describe how the process ended, with the last line that it printed."""
        if self.process is None:
            self.close()
            return "has ended"
        self._waits = True
        self.close()
        code = self.process.returncode
        said = f"was killed by signal {-code}" if code < 0 else f"ended with exit status {code}"
        return said + last_line(self._output) if code > 0 else said

    @property
    def usable(self) -> bool:
        """True if the server is running and can be used by another engine."""
        alive = self.process is None or self.process.poll() is None
        return self._owner == os.getpid() and self.peer.fileno() >= 0 and alive

    def close(self) -> None:
        """End the server: one that waits for a message ends by itself; another is killed, unless it ends soon."""
        if self._owner != os.getpid():  # this is a copy in a forked process
            return
        self.peer.close()
        if self.process is None:
            return
        try:
            self.process.wait(SILENCE if self._waits else ENDING)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


ENDING = 2.0  # time (s) in which a server that does not answer, or is interrupted, may end by itself
IDLE: dict[tuple[object, ...], list[Server]] = defaultdict(list)


class ServedEngine(Engine):
    """An engine in a server. A subclass starts the server and defines the message that loads a State."""

    def __init__(self, state: State, threads: int = 1) -> None:
        """Load the state into an idle server, or into a new one."""
        key = (type(self), threads)
        idle = IDLE[key]
        idle[:] = [server for server in idle if server.usable]
        self.server = idle.pop() if idle else self.start_server(threads)
        weakref.finalize(self, idle.append, self.server).atexit = False
        self.version = self.server.version
        self.load(state)

    @classmethod
    @abc.abstractmethod
    def start_server(cls, threads: int) -> Server:
        """Start the server with a number of threads."""

    @abc.abstractmethod
    def load_message(self, state: State) -> tuple[Values, dict[str, np.ndarray]]:
        """Return the values and arrays of the message that loads a state. Raises InputError if the engine cannot."""

    def load(self, state: State) -> None:
        state = state.replace(columns={})  # servers refuse laws with further columns of history
        values, arrays = self.load_message(state)
        values |= {"time": state.time, "time_step": state.time_step, "step": state.step}
        self._loaded, self._ledger, self._step = state, state.ledger, state.step
        self._keep(self.server.ask("load", values, **{name: getattr(state, name) for name in STATE}, **arrays))

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        gradient = np.array(velocity_gradient, dtype=float)
        answer = self.server.ask("advance", {"steps": steps}, velocity_gradient=gradient)
        self._step += steps
        self._keep(answer)

    def _keep(self, answer: Message) -> None:
        """Store the stress and the cell from the answer to `load` or `advance`."""
        self._stress, self._cell = answer.arrays["stress"], answer.arrays["cell"]

    def stress(self) -> np.ndarray:
        return self._stress.copy()  # the stress came with the answer to the last `advance`

    def volume(self) -> float:
        return float(np.linalg.det(self._cell))

    def stop_grains(self) -> None:
        lost = self.server.ask("stop_grains").values["kinetic_energy"]
        self._ledger = self._ledger.plus(0.0, 0.0, 0.0, lost)

    def state(self) -> State:
        """Return the State with contacts sorted by grain; the server returns contacts in any order."""
        answer = self.server.ask("state")
        values, columns = answer.values, self._loaded.scene.contact_law.columns
        arrays = {name: answer.arrays[name] for name in answer.arrays.keys() & STATE.keys() - columns.keys()}
        self._extra = {name: array for name, array in answer.arrays.items() if name not in STATE}
        pair, shift, order, sign = sort_contacts(arrays["contact_grain"], arrays["contact_shift"])
        arrays |= {"contact_grain": pair, "contact_shift": shift}
        history = {name: sign * answer.arrays[name][order] for name in answer.arrays.keys() & columns.keys()}
        return self._loaded.replace(
            **arrays,
            **history_fields({}, history, len(pair)),
            time=values["time"],
            step=self._step,
            engine=self.name,
            engine_version=self.version,
            ledger=self._ledger.plus(values["work"], *values["losses"]),
        )

"""LAMMPS on all ranks as a server: `mpiexec -n N python -P -m labkit.engines.lammps.server SOCKET`.

Rank 0 answers labkit's messages (yade_scripts/server.py lists them) on the Unix socket SOCKET. All other ranks
repeat each call that rank 0 makes to its Domain.
"""

from __future__ import annotations

import contextlib
import signal
import socket
import sys
import time
from typing import Any

import numpy as np
from mpi4py import MPI

from labkit.engines.lammps.domain import Domain
from labkit.engines.lammps.parts import gather_parts
from labkit.engines.server import PROTOCOL, Message, Values, receive, send
from labkit.errors import PhysicsError
from labkit.files.schema import STATE
from labkit.grains.scene import Scene
from labkit.grains.state import State

END = "end"  # message that tells the other ranks that rank 0 has finished
UNKNOWN = float("nan")  # value of the losses, which LAMMPS does not sum
LEAST_ROOM = 10  # if fewer steps than this are safe, the neighbour search is repeated
SILENCE = 10.0  # time (s) after which a long `advance` reports that it is alive


class LammpsServer:
    """LAMMPS with the grains of one State, seen from rank 0. Each public method answers the message with its name."""

    def __init__(self, domain: Domain, peer: socket.socket) -> None:
        """Store the domain of rank 0 and the socket to labkit."""
        self._domain, self._peer = domain, peer
        self._step = 0

    def _all(self, name: str, *arguments: object) -> Any:
        """Call a method of Domain on all ranks, and return the result of rank 0."""
        self._domain.comm.bcast((name, arguments))
        try:
            return getattr(self._domain, name)(*arguments)
        except Exception as error:
            if type(error) is not Exception:  # LAMMPS's Python module raises no other exceptions
                raise
            raise PhysicsError(f"LAMMPS stopped at step {self._step}: {error}") from None

    def load(self, message: Message) -> Message:
        """Load the State in the message; the value `work` is the work (J) done on the cell so far."""
        values = message.values
        arrays: Values = {name: message.arrays[name] for name in STATE}
        self._step, self._time, self._work = values["step"], values["time"], values["work"]
        self._loss, self._searches = 0.0, 0
        state = State(Scene.from_json(values["scene"]), **arrays, time_step=values["time_step"])
        self._load(state, tilted=False)
        return self.stress(message)

    def _load(self, state: State, tilted: bool) -> None:
        self._all("load", state, tilted)
        self._start = state
        self._stress, self._room = self._all("stress"), 0

    def advance(self, message: Message) -> Message:
        """Advance, with a neighbour search when it is due."""
        gradient, steps = message.arrays["velocity_gradient"], message.values["steps"]
        if np.triu(gradient, 1).any() and not self._domain.tilted:
            self._load(self._now(), tilted=True)
        due = time.monotonic() + SILENCE
        while steps:
            part = min(steps, self._steps_until_search(gradient))
            self._advance(part, gradient)
            steps, self._room = steps - part, self._room - part
            if time.monotonic() > due:
                send(self._peer, Message("alive", {}, {}))
                due = time.monotonic() + SILENCE
        return self.stress(message)

    def _steps_until_search(self, gradient: np.ndarray) -> int:
        """Return the number of safe steps; if it is small, first reload the State, which searches for neighbours."""
        if self._room < 1:
            self._room = self._all("room", gradient)
            if self._room < LEAST_ROOM:
                self._load(self._now(), tilted=self._domain.tilted)
                self._searches += 1
                self._room = max(self._all("room", gradient), LEAST_ROOM)
        return self._room

    def _advance(self, steps: int, gradient: np.ndarray) -> None:
        before, time_step = self._stress, self._start.time_step
        self._all("advance", steps, gradient)
        self._step += steps
        self._time += steps * time_step
        self._stress, self._loss = self._all("stress"), UNKNOWN
        strain = -gradient * steps * time_step
        volume = float(np.linalg.det(self._domain.cell))
        self._work += volume * float(np.sum(0.5 * (before + self._stress) * strain.T))

    def stress(self, message: Message) -> Message:
        """Return Love's stress after the last step."""
        return Message(message.name, {"searches": self._searches}, {"stress": self._stress, "cell": self._domain.cell})

    def stop_grains(self, message: Message) -> Message:
        """Load the State at rest; the energy dissipated is unknown, like all losses."""
        state = self._now()
        still = dict.fromkeys(("velocity", "angular_velocity"), np.zeros_like(state.position))
        self._load(state.replace(**still, velocity_gradient=np.zeros((3, 3))), tilted=self._domain.tilted)
        return Message(message.name, {"kinetic_energy": 0.0}, {})

    def state(self, message: Message) -> Message:
        """Return the State, gathered from all ranks."""
        state = self._now()
        values = {"time": self._time, "work": self._work, "losses": [self._loss] * 3}
        return Message(message.name, values, {name: getattr(state, name) for name in STATE if name != "radius"})

    def _now(self) -> State:
        cell, gradient = self._domain.cell.copy(), self._domain.gradient.copy()
        parts = self._all("all_parts")
        return self._start.replace(cell=cell, velocity_gradient=gradient, **gather_parts(parts, cell))

    def serve(self) -> None:
        """Answer messages until labkit exits or sends `quit`."""
        processors = self._domain.comm.size
        hello = {"protocol": PROTOCOL, "version": self._domain.version, "threads": processors}
        with contextlib.suppress(EOFError, OSError):
            send(self._peer, Message("hello", hello, {}))
            while (message := receive(self._peer)).name != "quit":
                try:
                    answer = getattr(self, message.name)(message)
                except OSError:  # raised by the report that the server is alive
                    return
                except PhysicsError as error:
                    answer = Message("error", {"text": str(error)}, {})
                except Exception as error:
                    answer = Message("error", {"text": f"LAMMPS stopped: {type(error).__name__}: {error}"}, {})
                send(self._peer, answer)


def follow_first_rank(domain: Domain) -> None:
    """Repeat the calls of rank 0 until it has finished."""
    while True:
        name, arguments = domain.comm.bcast(None)
        if name == END:
            return
        with contextlib.suppress(Exception):  # rank 0 has the same error and reports it
            getattr(domain, name)(*arguments)


def serve_ranks(name: str) -> None:
    """Serve the socket on rank 0, or follow rank 0."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # labkit decides when to stop, and closes the socket
        signal.signal(number, signal.SIG_IGN)
    domain = Domain(MPI.COMM_WORLD)
    if domain.comm.rank:
        follow_first_rank(domain)
        return
    with socket.socket(socket.AF_UNIX) as peer:
        peer.connect(name)
        LammpsServer(domain, peer).serve()
    domain.comm.bcast((END, ()))


if __name__ == "__main__":
    serve_ranks(sys.argv[1])

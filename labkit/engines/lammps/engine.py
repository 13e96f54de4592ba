"""The engine `lammps`: LAMMPS on one or more MPI ranks, with the spring-dashpot law.

The run itself is on rank 0, as with any engine. The other ranks wait for the calls that rank 0 makes of its Domain and
make the same ones (`follow`).
"""

from __future__ import annotations

import contextlib
from typing import Any, ClassVar

import numpy as np

from labkit.dem.engine import Engine, Progress
from labkit.dem.instant import Instant
from labkit.dem.loading import Path
from labkit.dem.observed import Observed
from labkit.dem.scene import Scene
from labkit.dem.state import State
from labkit.engines.lammps.domain import Domain
from labkit.engines.lammps.parts import gathered
from labkit.engines.lammps.process import require_lammps, run_ranks
from labkit.engines.lammps.records import PartialInstant
from labkit.errors import InputError, PhysicsError

END = "end"  # what tells the other ranks that rank 0 has finished
ON_RANKS = (
    "position",
    "velocity",
    "angular_velocity",
    "contact_grain",
    "contact_shift",
    "tangential_force",
    "rolling_moment",
)
UNKNOWN = (float("nan"),) * 3  # losses: LAMMPS sums none
LEAST_ROOM = 10  # steps; with less, neighbours are searched


class LammpsEngine(Engine):
    """LAMMPS with one State loaded, seen from rank 0. `threads` is the number of ranks."""

    name = "lammps"
    parallel = "ranks"
    on_rank: ClassVar[bool] = False  # set in such a process

    @classmethod
    def here(cls) -> bool:
        """True in a process that mpiexec has started for a task."""
        return cls.on_rank

    @classmethod
    def elsewhere(cls, job: str, processors: int, progress: Progress) -> None:
        run_ranks(job, processors, progress)

    @classmethod
    def require(cls, scene: Scene) -> None:
        """Raise InputError for a scene that LAMMPS cannot simulate, or if LAMMPS is not installed."""
        if scene.law != "spring_dashpot":
            raise InputError(f"has no contact law {scene.law}: use spring_dashpot", field="engine", value=cls.name)
        if scene.planar:
            raise InputError("has no planar layers", field="engine", value=cls.name, allowed="fused")
        require_lammps()

    @classmethod
    def require_path(cls, path: Path) -> None:
        """Raise InputError for a path that turns the cell: its shear rates are symmetric, or found by the servo."""
        control = path.control()
        free = control is not None and control.components > 3 and control.free[3:].any()
        if free or np.tril(path.flow(0.0), -1).any():
            raise _turns()

    def __init__(self, state: State, threads: int = 1) -> None:
        """Load the state. Raises InputError if this process does not have `threads` ranks."""
        from mpi4py import MPI

        comm = MPI.COMM_WORLD
        if comm.size != threads:
            reason = f"is not valid: this process has {comm.size}"
            raise InputError(reason, field="ranks", value=threads, allowed=str(comm.size))
        self._comm = comm
        self._domain = domain_of(comm)
        self.version = self._domain.version
        self._steps = state.step
        self.load(state)

    def _all(self, name: str, *arguments: Any) -> Any:
        """Call a method of Domain on all ranks; returns the result of rank 0."""
        self._comm.bcast((name, arguments))
        try:
            return getattr(self._domain, name)(*arguments)
        except Exception as error:
            if type(error) is not Exception:  # LAMMPS's Python module raises no other
                raise
            raise PhysicsError(f"LAMMPS stopped at step {self._steps}: {error}") from None

    def load(self, state: State, tilted: bool = False) -> None:
        self._all("load", state, tilted)
        self._state, self._ledger = state.replace(**dict.fromkeys(ON_RANKS)), state.ledger
        self._steps, self._time, self._before, self._room = state.step, state.time, self.stress(), 0

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        gradient = np.array(velocity_gradient, dtype=float)
        if np.abs(np.tril(gradient, -1)).max() > 1e-12 * np.abs(gradient).max():
            raise _turns()
        if np.triu(gradient, 1).any() and not self._domain.tilted:
            self.load(self.state(), tilted=True)
        while steps:
            part = min(steps, self._steps_until_search(gradient))
            self._advance(part, gradient)
            steps, self._room = steps - part, self._room - part

    def _steps_until_search(self, gradient: np.ndarray) -> int:
        """Number of steps that can be made now; loads the State, and so searches neighbours, if it would be small."""
        if self._room < 1:
            self._room = self._all("room", gradient)
            if self._room < LEAST_ROOM:
                self.load(self.state(), tilted=self._domain.tilted)
                self._room = max(self._all("room", gradient), LEAST_ROOM)
        return self._room

    def _advance(self, steps: int, gradient: np.ndarray) -> None:
        before = self._before
        self._all("advance", steps, gradient)
        self._steps += steps
        self._time += steps * self._state.time_step
        self._before = self.stress()
        strain = -gradient * steps * self._state.time_step
        work = self._volume * float(np.sum(0.5 * (before + self._before) * strain.T))
        self._ledger = self._ledger.plus(work, *UNKNOWN)

    @property
    def _volume(self) -> float:
        return float(np.linalg.det(self._domain.cell))

    def stress(self) -> np.ndarray:
        return self._all("stress")

    def stop_grains(self) -> None:
        state = self.state()
        still = dict.fromkeys(("velocity", "angular_velocity"), np.zeros_like(state.position))
        self.load(state.replace(**still, velocity_gradient=np.zeros((3, 3))), tilted=self._domain.tilted)

    def state(self) -> State:
        return self._brief().replace(**gathered(self._all("all_parts"), self._domain.cell))

    def instant(self) -> Instant:
        return PartialInstant(self._brief(), self)

    def observed(self, brief: State) -> tuple[Observed, np.ndarray]:
        """The quantities of a record and the stiffness of the cell, summed over the ranks."""
        return self._all("observe", brief.replace(radius=None, history="", provenance=""))

    def _brief(self) -> State:
        """The State without grains and contacts, with the radii."""
        return self._state.replace(
            cell=self._domain.cell.copy(),
            velocity_gradient=self._domain.gradient.copy(),
            time=self._time,
            step=self._steps,
            engine=self.name,
            engine_version=self.version,
            ledger=self._ledger,
        )


def _turns() -> InputError:
    return InputError(
        "the path turns the first vector of the cell, or the plane of the first two, which LAMMPS cannot: use "
        "--engine fused, or a path along x, y and z or simple shear"
    )


_DOMAINS: dict[int, Domain] = {}


def domain_of(comm: Any) -> Domain:
    """The Domain of this process, started at the first call."""
    if not _DOMAINS:
        _DOMAINS[0] = Domain(comm)
    return _DOMAINS[0]


def follow(comm: Any) -> None:
    """Make the calls that rank 0 makes, until it has finished."""
    domain = domain_of(comm)
    while True:
        name, arguments = comm.bcast(None)
        if name == END:
            return
        with contextlib.suppress(Exception):  # rank 0 has the same error and reports it
            getattr(domain, name)(*arguments)


def dismiss(comm: Any) -> None:
    """Tell the other ranks that rank 0 has finished."""
    comm.bcast((END, ()))

"""The boundary value problem: a plane-strain biaxial test on a specimen that is looser at its centre.

Small strains. x is lateral, y axial, z out of plane; one quarter of the specimen is modelled, with smooth platens and a
constant lateral stress. A program solves one increment at a time with Newton's method and the consistent tangent of the
law; an increment that fails is halved.
"""

from __future__ import annotations

import abc
import dataclasses
import time
from collections.abc import Callable

import numpy as np

HEIGHT, WIDTH = 0.1, 0.05  # size of the quarter, m
PRESSURE = 0.5e6  # Pa
VOID_RATIO, LOOSER, RADIUS = 0.62, 0.03, 0.02  # void ratio far from the centre, its rise at the centre, radius (m)
TOLERANCE = 1e-9  # residual over the norm of the external forces
MOST_ITERATIONS = 12
FIELDS = ("e", "Z", "|A|")


def void_ratio(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Initial void ratio at the points x, y (m), arrays of one shape."""
    return VOID_RATIO + LOOSER * np.exp(-(x**2 + y**2) / RADIUS**2)


@dataclasses.dataclass(frozen=True)
class Increment:
    """A converged increment: change of the displacement (m), axial force (N/m), residuals before each iteration."""

    change: np.ndarray
    force: float
    residuals: list[float]


@dataclasses.dataclass
class History:
    """The records of every increment: axial strain, axial stress (Pa), and the residuals of its iterations."""

    strain: list[float] = dataclasses.field(default_factory=lambda: [0.0])
    stress: list[float] = dataclasses.field(default_factory=list)
    residuals: list[list[float]] = dataclasses.field(default_factory=list)
    cuts: int = 0
    wall_time: float = 0.0

    @property
    def iterations(self) -> np.ndarray:
        """Newton iterations of every increment."""
        return np.array([len(found) - 1 for found in self.residuals])


class Problem(abc.ABC):
    """A body that the displacement of a rigid part strains: the platen of the biaxial test, or a footing."""

    breadth: float  # of the rigid part, m: its force per breadth is the axial stress
    pressure: float  # axial stress at the start, Pa

    @abc.abstractmethod
    def uniform(self, strain: float) -> np.ndarray:
        """Displacement for a uniform axial strain without lateral strain."""

    @abc.abstractmethod
    def increment(self, step: float, start: np.ndarray) -> Increment | None:
        """Compress by the axial strain `step` from the estimate `start`; None if it fails, and nothing changes."""

    def run(self, strain: float, increments: int, progress: Callable[[float, str], None]) -> History:
        """Strain the specimen axially in equal increments, compression positive; returns the History of this strain.

        Another call goes on from there, and reverses if its strain has the other sign. Ends early if an increment
        cannot be solved after it was halved eight times.
        """
        history, begin, goal = History(stress=[self.pressure]), time.perf_counter(), strain / increments
        step, done, change = goal, 0.0, self.uniform(goal)  # change of displacement over the increment to `goal`
        while abs(done) < abs(strain) * (1.0 - 1e-9):
            step = min(step, strain - done, key=abs)
            found = self.increment(step, change * step / goal)
            if found is None:
                history.cuts, step, change = history.cuts + 1, 0.5 * step, self.uniform(goal)
                if abs(step) < abs(goal) / 256:
                    break
                continue
            change, done = found.change * goal / step, done + step
            step = min(goal, 2.0 * step, key=abs)
            history.residuals.append(found.residuals)
            history.strain.append(done)
            history.stress.append(found.force / self.breadth)
            progress(done / strain, f"axial strain {done:.2%}")
        history.wall_time = time.perf_counter() - begin
        return history


class Biaxial(Problem):
    """The test on a mesh of `columns` x `2 columns` quadratic elements, solved by one program.

    `program` and `element` are names for the table; `unknowns` is the number of free displacements.
    """

    program: str
    element: str
    columns: int
    unknowns: int
    breadth, pressure = WIDTH, PRESSURE

    @abc.abstractmethod
    def field(self, name: str) -> np.ndarray:
        """One of FIELDS at the integration points, (rows, columns, points), from the lower left corner."""

    @property
    def elements(self) -> int:
        """Number of elements."""
        return 2 * self.columns**2

"""A plane-strain biaxial test on a specimen that is looser at its centre, solved with scikit-fem.

Small strains, quadratic elements with nine integration points. x is lateral, y axial, z out of plane; one quarter of
the specimen is modelled, with smooth platens and a constant lateral stress. Newton's method with the consistent tangent
of the law; an increment that fails at a point, or that does not converge, is halved.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse.linalg
import skfem
from skfem.helpers import ddot, sym_grad

from labkit.model import Model, isotropic_state, states

HEIGHT, WIDTH = 0.1, 0.05  # m, of the quarter
PRESSURE = 0.5e6  # Pa
VOID_RATIO, LOOSER, RADIUS = 0.62, 0.03, 0.02  # void ratio far from the centre, its rise at the centre, radius (m)
TOLERANCE = 1e-9  # residual over the norm of the external forces
MOST_ITERATIONS = 12
IN_PLANE = [0, 1, 5]  # xx, yy, sqrt2 xy of Mandel's xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy

Law = Callable[[np.ndarray, np.ndarray], Any]  # (state, increment) -> an Update of labkit.model


@dataclasses.dataclass
class History:
    """What is recorded at every increment: axial strain, axial stress (Pa), and the residuals of its iterations."""

    strain: list[float] = dataclasses.field(default_factory=lambda: [0.0])
    stress: list[float] = dataclasses.field(default_factory=lambda: [PRESSURE])
    residuals: list[list[float]] = dataclasses.field(default_factory=list)
    cuts: int = 0
    law_time: float = 0.0
    wall_time: float = 0.0

    @property
    def iterations(self) -> np.ndarray:
        """Newton iterations of every increment."""
        return np.array([len(found) - 1 for found in self.residuals])


@skfem.BilinearForm
def _stiffness(u, v, w):
    strain, test = _mandel(sym_grad(u)), _mandel(sym_grad(v))
    return sum(w[f"T{i}{j}"] * test[i] * strain[j] for i in range(3) for j in range(3))


@skfem.LinearForm
def _internal(v, w):
    test = _mandel(sym_grad(v))
    return sum(w[f"s{i}"] * test[i] for i in range(3))


@skfem.LinearForm
def _lateral(v, w):
    return PRESSURE * ddot(np.eye(2)[:, :, None, None] * np.ones_like(w.x[0]), _outer(v, w.n))


def _outer(v, n):
    return np.einsum("i...,j...->ij...", np.asarray(v), n)


def _mandel(tensor):
    return tensor[0, 0], tensor[1, 1], np.sqrt(2.0) * tensor[0, 1]


class Biaxial:
    """The test on a mesh of `columns` x `2 columns` elements, with a law for the points."""

    def __init__(self, columns: int, law: Law, model: Model) -> None:
        """Mesh, boundary conditions and initial states."""
        x, y = np.linspace(0, WIDTH, columns + 1), np.linspace(0, HEIGHT, 2 * columns + 1)
        self.law, self.model = law, model
        self.mesh = skfem.MeshQuad.init_tensor(x, y)
        self.basis = skfem.Basis(self.mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
        self.displacement = np.zeros(self.basis.N)
        self.points = self.basis.global_coordinates().value  # (2, elements, points)
        right = skfem.FacetBasis(
            self.mesh, self.basis.elem, facets=self.mesh.facets_satisfying(lambda p: p[0] == WIDTH)
        )
        self.lateral = _lateral.assemble(right)
        self.top = self.basis.get_dofs(lambda p: np.isclose(p[1], HEIGHT)).all("u^2")
        fixed = [
            self.basis.get_dofs(lambda p: np.isclose(p[0], 0.0)).all("u^1"),
            self.basis.get_dofs(lambda p: np.isclose(p[1], 0.0)).all("u^2"),
            self.top,
        ]
        self.free = np.setdiff1d(np.arange(self.basis.N), np.concatenate(fixed))
        self.state = self._initial()

    def _initial(self) -> np.ndarray:
        distance = np.hypot(*self.points).ravel()
        void_ratio = VOID_RATIO + LOOSER * np.exp(-((distance / RADIUS) ** 2))
        return np.vstack([states(isotropic_state(self.model, float(e), PRESSURE), 1) for e in void_ratio])

    def field(self, name: str) -> np.ndarray:
        """e, Z or |A| at the points, (elements, points)."""
        values = {"e": self.state[:, 0], "Z": self.state[:, 1], "|A|": np.linalg.norm(self.state[:, 3:9], axis=1)}
        return values[name].reshape(self.points.shape[1:])

    def run(self, strain: float, increments: int, progress: Callable[[float, str], None]) -> History:
        """Compress the specimen by an axial strain in equal increments; returns the History.

        Ends early if an increment cannot be solved after it was halved eight times.
        """
        history, begin, goal = History(), time.perf_counter(), strain / increments
        step, done, guess = goal, 0.0, np.zeros(self.basis.N)
        while done < strain * (1.0 - 1e-9):
            step = min(step, strain - done)
            start = guess * step / goal
            found = self._increment(step, start, history)
            if found is None:
                history.cuts, step, guess = history.cuts + 1, 0.5 * step, np.zeros(self.basis.N)
                if step < goal / 256:
                    break
                continue
            change, self.state, force = found
            self.displacement += change
            guess, done = change * goal / step, done + step
            step = min(goal, 2.0 * step)
            history.strain.append(done)
            history.stress.append(force / WIDTH)
            progress(done / strain, f"axial strain {done:.2%}")
        history.wall_time = time.perf_counter() - begin
        return history

    def _increment(self, step, start, history):
        """(change of displacement, new state, axial force) of an increment, or None if it failed."""
        change, residuals = start.copy(), []
        change[self.top] = -step * HEIGHT
        for _ in range(MOST_ITERATIONS + 1):
            begin = time.perf_counter()
            update = self.law(self.state, self._strain(change))
            history.law_time += time.perf_counter() - begin
            if update.status.any():
                return None
            inner, stiffness = self._assembled(update)
            out = inner - self.lateral  # both count compression as positive
            residuals.append(float(np.linalg.norm(out[self.free]) / np.linalg.norm(self.lateral)))
            if residuals[-1] < TOLERANCE:
                history.residuals.append(residuals)
                return change, update.state, abs(inner[self.top].sum())
            matrix = stiffness[self.free][:, self.free].tocsc()
            change[self.free] += scipy.sparse.linalg.spsolve(matrix, out[self.free])
        return None

    def _strain(self, displacement):
        """Strain increments (points, 6), compression positive."""
        gradient = self.basis.interpolate(displacement).grad
        strain = np.zeros((6, *self.points.shape[1:]))
        strain[IN_PLANE] = [-part for part in _mandel(0.5 * (gradient + gradient.swapaxes(0, 1)))]
        return strain.reshape(6, -1).T

    def _assembled(self, update):
        shape = self.points.shape[1:]
        stress = {f"s{i}": update.stress[:, k].reshape(shape) for i, k in enumerate(IN_PLANE)}
        tangent = {
            f"T{i}{j}": update.tangent[:, k, m].reshape(shape)
            for i, k in enumerate(IN_PLANE)
            for j, m in enumerate(IN_PLANE)
        }
        return _internal.assemble(self.basis, **stress), _stiffness.assemble(self.basis, **tangent)

"""The biaxial test in scikit-fem: nine-node elements with nine integration points; the law is called for all points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse.linalg
import skfem
from skfem.helpers import sym_grad

from examples.boundary_value import problem
from labkit.model import Model, isotropic_state, states

IN_PLANE = [0, 1, 5]  # xx, yy, sqrt2 xy of Mandel's xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy

Law = Callable[[np.ndarray, np.ndarray], Any]  # (state, increment) -> an Update of labkit.model


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
    return problem.PRESSURE * (v[0] * w.n[0] + v[1] * w.n[1])


def _mandel(tensor):
    return tensor[0, 0], tensor[1, 1], np.sqrt(2.0) * tensor[0, 1]


class ScikitFem(problem.Biaxial):
    """The test in scikit-fem, with a law for all points at once: `law(state (n, 21), increment (n, 6))`."""

    program, element = "scikit-fem", "nine nodes, nine points"

    def __init__(self, columns: int, law: Law, model: Model) -> None:
        """Mesh, boundary conditions and initial states."""
        x, y = np.linspace(0, problem.WIDTH, columns + 1), np.linspace(0, problem.HEIGHT, 2 * columns + 1)
        self.law, self.columns = law, columns
        self.mesh = skfem.MeshQuad.init_tensor(x, y)
        self.basis = skfem.Basis(self.mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
        self.points = np.asarray(self.basis.global_coordinates())  # (2, elements, points)
        right = skfem.FacetBasis(
            self.mesh, self.basis.elem, facets=self.mesh.facets_satisfying(lambda p: p[0] == problem.WIDTH)
        )
        self.lateral = _lateral.assemble(right)
        self.top = self.basis.get_dofs(lambda p: np.isclose(p[1], problem.HEIGHT)).all("u^2")
        fixed = [
            self.basis.get_dofs(lambda p: np.isclose(p[0], 0.0)).all("u^1"),
            self.basis.get_dofs(lambda p: np.isclose(p[1], 0.0)).all("u^2"),
            self.top,
        ]
        self.free = np.setdiff1d(np.arange(self.basis.N), np.concatenate(fixed))
        self.unknowns = len(self.free)
        initial = problem.void_ratio(*self.points).ravel()
        self.state = np.vstack([states(isotropic_state(model, float(e), problem.PRESSURE), 1) for e in initial])

    def uniform(self, strain: float) -> np.ndarray:
        """See Biaxial.uniform."""
        axial = self.basis.get_dofs(elements=True).all("u^2")
        displacement = np.zeros(self.basis.N)
        displacement[axial] = -strain * self.basis.doflocs[1, axial]
        return displacement

    def increment(self, step: float, start: np.ndarray) -> problem.Increment | None:
        """See Biaxial.increment."""
        change, residuals = start.copy(), []
        change[self.top] = -step * problem.HEIGHT
        for _ in range(problem.MOST_ITERATIONS + 1):
            update = self.law(self.state, self._strain(change))
            if update.status.any():
                return None
            inner, stiffness = self._assembled(update)
            out = inner - self.lateral  # both count compression as positive
            residuals.append(float(np.linalg.norm(out[self.free]) / np.linalg.norm(self.lateral)))
            if residuals[-1] < problem.TOLERANCE:
                self.state = update.state
                return problem.Increment(change, abs(inner[self.top].sum()), residuals)
            matrix = stiffness[self.free][:, self.free].tocsc()
            change[self.free] += scipy.sparse.linalg.spsolve(matrix, out[self.free])
        return None

    def field(self, name: str) -> np.ndarray:
        """See Biaxial.field."""
        values = {"e": self.state[:, 0], "Z": self.state[:, 1], "|A|": np.linalg.norm(self.state[:, 3:9], axis=1)}
        elements, points = self.points.shape[1:]
        centre = self.mesh.p[:, self.mesh.t].mean(axis=1)
        order = np.lexsort(np.round(centre, 9))
        return values[name].reshape(elements, points)[order].reshape(2 * self.columns, self.columns, points)

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

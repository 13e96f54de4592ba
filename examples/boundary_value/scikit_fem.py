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
Place = Callable[[np.ndarray], np.ndarray]  # points (2, n) -> whether they are there, (n,)


@skfem.BilinearForm
def _stiffness(u, v, w):
    strain, test = _mandel(sym_grad(u)), _mandel(sym_grad(v))
    return sum(w[f"T{i}{j}"] * test[i] * strain[j] for i in range(3) for j in range(3))


@skfem.LinearForm
def _internal(v, w):
    test = _mandel(sym_grad(v))
    return sum(w[f"s{i}"] * test[i] for i in range(3))


@skfem.LinearForm
def _traction(v, w):
    return w.pressure * (v[0] * w.n[0] + v[1] * w.n[1])


def _mandel(tensor):
    return tensor[0, 0], tensor[1, 1], np.sqrt(2.0) * tensor[0, 1]


class PlaneStrain(problem.Problem):
    """A rectangle in scikit-fem, with a law for all points at once: `law(state (n, 21), increment (n, 6))`."""

    height: float  # displacement per unit of strain, m

    def __init__(
        self, x: np.ndarray, y: np.ndarray, law: Law, model: Model, void_ratio: Callable[..., np.ndarray]
    ) -> None:
        """Mesh with nodes at x and y (m), and isotropic states with the void ratios `void_ratio(x, y)`."""
        self.law = law
        self.mesh = skfem.MeshQuad.init_tensor(x, y)
        self.basis = skfem.Basis(self.mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
        self.points = np.asarray(self.basis.global_coordinates())  # (2, elements, points)
        initial = void_ratio(*self.points).ravel()
        self.state = np.vstack([states(isotropic_state(model, float(e), self.pressure), 1) for e in initial])

    def bind(self, loaded: Place, driven: Place, *held: tuple[Place, str]) -> None:
        """The pressure acts where `loaded`, the rigid part moves where `driven`; `held`: places and displacements."""
        where = skfem.FacetBasis(self.mesh, self.basis.elem, facets=self.mesh.facets_satisfying(loaded))
        self.load = _traction.assemble(where, pressure=self.pressure)
        self.driven = self.basis.get_dofs(driven).all("u^2")
        fixed = [self.basis.get_dofs(place).all(name) for place, name in held]
        self.free = np.setdiff1d(np.arange(self.basis.N), np.concatenate([self.driven, *fixed]))
        self.unknowns = len(self.free)

    def uniform(self, strain: float) -> np.ndarray:
        """See Problem.uniform."""
        axial = self.basis.get_dofs(elements=True).all("u^2")
        displacement = np.zeros(self.basis.N)
        displacement[axial] = -strain * self.basis.doflocs[1, axial]
        return displacement

    def increment(self, step: float, start: np.ndarray) -> problem.Increment | None:
        """See Problem.increment."""
        change, residuals = start.copy(), []
        change[self.driven] = -step * self.height
        for _ in range(problem.MOST_ITERATIONS + 1):
            update = self.law(self.state, self._strain(change))
            if update.status.any():
                return None
            inner, stiffness = self._assembled(update)
            out = inner - self.load  # both count compression as positive
            residuals.append(float(np.linalg.norm(out[self.free]) / np.linalg.norm(self.load)))
            if residuals[-1] < problem.TOLERANCE:
                self.state = update.state
                return problem.Increment(change, abs(out[self.driven].sum()), residuals)
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


class ScikitFem(PlaneStrain, problem.Biaxial):
    """The biaxial test in scikit-fem."""

    program, element, height = "scikit-fem", "nine nodes, nine points", problem.HEIGHT

    def __init__(self, columns: int, law: Law, model: Model) -> None:
        """Mesh, boundary conditions and initial states."""
        x, y = np.linspace(0, problem.WIDTH, columns + 1), np.linspace(0, problem.HEIGHT, 2 * columns + 1)
        super().__init__(x, y, law, model, problem.void_ratio)
        self.columns = columns
        left, bottom = (lambda p: np.isclose(p[0], 0.0)), (lambda p: np.isclose(p[1], 0.0))
        right, top = (lambda p: p[0] == problem.WIDTH), (lambda p: np.isclose(p[1], problem.HEIGHT))
        self.bind(right, top, (left, "u^1"), (bottom, "u^2"))

    def field(self, name: str) -> np.ndarray:
        """See Biaxial.field."""
        values = {"e": self.state[:, 0], "Z": self.state[:, 1], "|A|": np.linalg.norm(self.state[:, 3:9], axis=1)}
        elements, points = self.points.shape[1:]
        centre = self.mesh.p[:, self.mesh.t].mean(axis=1)
        order = np.lexsort(np.round(centre, 9))
        return values[name].reshape(elements, points)[order].reshape(2 * self.columns, self.columns, points)

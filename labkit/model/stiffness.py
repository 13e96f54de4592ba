"""Incremental stiffness: d sigma/d epsilon of the equations (Eq. 33), and the hypoplastic form (Eq. 34).

sigma' = d sigma/dt is homogeneous of degree one in the strain rate D and depends on its direction: a stiffness is
defined only for a given direction. labkit.plugins.umat.material_point has the consistent tangent of a
finite increment.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.tensors import require_symmetric, to_six, to_tensor
from labkit.model.compiled import Pointer, address, constants_at, entry, numbers_at
from labkit.model.differentials import STATE, rates_differentials, stress_rate_of
from labkit.model.equations import strain_driven
from labkit.model.parameters import Model
from labkit.model.rates import SIZE
from labkit.model.state import ModelState, deviatoric_basis
from labkit.model.tensors import put, put_six, six_at, trace


def state_rate(model: Model, state: ModelState, D: np.ndarray) -> np.ndarray:
    """Rates of e, Z, Lambda, A, F, F^t by C1 to C5 for strain rates D (..., 3, 3), 1/s; (..., 21), Mandel notation.

    Raises InputError unless D is symmetric and finite.
    """
    return _evaluate(model, state, D)[0]


def stress_rate(model: Model, state: ModelState, D: np.ndarray) -> np.ndarray:
    """Stress rate d sigma/dt (..., 3, 3), Pa/s, for strain rates D (..., 3, 3), 1/s: Eq. 33 with C0's coupled terms.

    Raises InputError unless D is symmetric and finite.
    """
    return to_tensor(_evaluate(model, state, D)[1])


def rate_tangent(model: Model, state: ModelState, D: np.ndarray) -> np.ndarray:
    """Return the tangent d(sigma')/dD at the strain rate D (3, 3); (6, 6) in Mandel notation, Pa.

    sigma' = tangent : D, as for any function that is homogeneous of degree one (Euler). Raises InputError unless D is
    symmetric and finite.
    """
    D = to_six(require_symmetric("the strain rate", D))
    tangent = np.empty((6, 6))
    y, work = state.vector(), np.zeros((20, STATE))
    addresses = (address(array) for array in (y, D, model.numbers, tangent, work))
    _rate_tangent.of(type(model.constants))(*addresses)
    return tangent


@dataclasses.dataclass(frozen=True, eq=False)
class HypoplasticForm:
    """sigma' = Lv rate_v + Ls : dev D + N |dev D| on one branch of Eqs. 31 and 32 (Eq. 34).

    Args:
        Lv: Coefficient of the volumetric strain rate, (3, 3), Pa.
        Ls: Coefficient of the deviatoric strain rate, (3, 3, 3, 3), Pa.
        N: Coefficient of the norm of the deviatoric strain rate, (3, 3), Pa.
        misfit: RMS residual of this form under deviatoric strain rates, relative to the RMS of sigma'.
    """

    Lv: np.ndarray
    Ls: np.ndarray
    N: np.ndarray
    misfit: float

    def stress_rate(self, D: np.ndarray) -> np.ndarray:
        """Return the stress rate of this form for strain rates D (..., 3, 3), 1/s; shape (..., 3, 3), Pa/s."""
        volumetric = np.trace(D, axis1=-2, axis2=-1)[..., None, None]
        deviator = D - volumetric / 3 * np.eye(3)
        size = np.linalg.norm(deviator, axis=(-2, -1))[..., None, None]
        return self.Lv * volumetric + np.einsum("ijkl,...kl->...ij", self.Ls, deviator) + self.N * size


def hypoplastic_form(
    model: Model, state: ModelState, compressing: bool = True, directions: int = 500
) -> HypoplasticForm:
    """Determine Lv, Ls and N by evaluating the equations; returns a HypoplasticForm.

    Ls and N are the least-squares fit to sigma' over random directions of the deviatoric unit sphere. Properties:

    * On each branch of Eqs. 31 and 32, sigma' is exactly the sum of a volumetric and a deviatoric part.
    * The volumetric part is parallel to sigma: Lv = sigma (f^{v,Z}/Z + f^{v,L}/Lambda + 1), whereas Eq. 34 has L^v I.
      The two agree only for an isotropic stress.
    * The deviatoric part is exactly Ls : dev D + N |dev D| if gamma_A = gamma_F = c_Z = 0, or where A = F = 0.
      Otherwise the factors |f A^c - A|^gamma and |dA/dt| depend on the angle between the strain rate and A: Eq. 34,
      which the paper calls conceptual, is then an approximation with the error `misfit`.
    """
    sign = 1.0 if compressing else -1.0
    volumetric = sign * stress_rate(model, state, sign * np.eye(3) / 3)
    basis = deviatoric_basis()
    weights = np.random.default_rng(0).normal(size=(directions, 5))
    weights /= np.linalg.norm(weights, axis=1)[:, None]
    rates = to_six(stress_rate(model, state, np.einsum("dk,kij->dij", weights, basis)))
    design = np.column_stack([weights, np.ones(directions)])
    columns = np.linalg.lstsq(design, rates, rcond=None)[0]
    misfit = np.linalg.norm(design @ columns - rates) / np.linalg.norm(rates)
    linear = np.einsum("kij,kmn->ijmn", to_tensor(columns[:5]), basis)
    return HypoplasticForm(volumetric, linear, to_tensor(columns[5]), float(misfit))


def _evaluate(model, state, D):
    D = to_six(require_symmetric("the strain rate", D))
    flat = np.ascontiguousarray(D.reshape(-1, 6))
    rates, stresses = np.empty((len(flat), STATE)), np.empty((len(flat), 6))
    y, work = state.vector(), np.empty(SIZE)
    addresses = (address(array) for array in (y, flat, model.numbers, rates, stresses, work))
    _rates.of(type(model.constants))(*addresses, len(flat))
    return rates.reshape((*D.shape[:-1], STATE)), stresses.reshape(D.shape)


@entry
def _rates(y: Pointer, D: Pointer, c: Pointer, rates: Pointer, stresses: Pointer, work: Pointer, n: int) -> int:
    state, constants, out = numbers_at(y, SIZE), constants_at(c), numbers_at(work, SIZE)
    strains, reached, stress = numbers_at(D, (n, 6)), numbers_at(rates, (n, STATE)), numbers_at(stresses, (n, 6))
    for k in range(n):
        rate = six_at(strains[k], 0)
        strain_driven(state, rate, trace(rate) > 0.0, constants, out)
        put(reached[k], out[:STATE])
        put_six(stress[k], 0, stress_rate_of(state, out, constants))
    return 0


@entry
def _rate_tangent(y: Pointer, D: Pointer, c: Pointer, tangent: Pointer, work: Pointer) -> int:
    """Compute the tangent of `rate_tangent`; `work` (20, STATE) must be zero."""
    state, rate, constants = numbers_at(y, SIZE), six_at(numbers_at(D, 6), 0), constants_at(c)
    slope, space = numbers_at(tangent, (6, 6)), numbers_at(work, (20, STATE))
    unchanged, identity, rows = space[:6], space[6:12], space[12:18]
    for k in range(6):
        identity[k, k] = 1.0
    rates_differentials(state, rate, trace(rate) > 0.0, constants, unchanged, identity, rows, space[18:])
    for k in range(6):
        column = stress_rate_of(state, rows[k], constants)
        for i in range(6):
            slope[i, k] = column[i]
    return 0

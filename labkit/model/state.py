"""ModelState, the internal state of the model at a point, and the initial states of tests."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.errors import InputError
from labkit.micro.fabric import Statistics, statistics
from labkit.micro.snapshot import Snapshot
from labkit.micro.tensors import require_symmetric, symmetric, to_six, to_tensor
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.model.equations import compression_coordination_number
from labkit.model.parameters import TABLE_2, Model
from labkit.parameters import parameters_of
from labkit.paths.path import StressPath
from labkit.sff.c0 import c0_stress, symmetric_product


def _zero() -> np.ndarray:
    return np.zeros((3, 3))


@dataclasses.dataclass(frozen=True, eq=False)
class ModelState:
    """e, Z, Lambda (scalars) and A, F, F^t (3, 3), symmetric and deviatoric, compression positive.

    Raises InputError for an impossible state: e not positive, Z or Lambda negative, a tensor that is not symmetric or
    not deviatoric, or an A for which the density of contact normals (Eq. 9) is negative in some direction.
    """

    e: float
    Z: float
    Lam: float
    A: np.ndarray = dataclasses.field(default_factory=_zero)
    F: np.ndarray = dataclasses.field(default_factory=_zero)
    Ft: np.ndarray = dataclasses.field(default_factory=_zero)

    def __post_init__(self) -> None:
        """Convert to float and check. Raises InputError for an impossible state."""
        for name, label, least in (
            ("e", "void ratio", "above 0"),
            ("Z", "coordination number", "0 or more"),
            ("Lam", "mean normalised force", "0 or more"),
        ):
            value = float(getattr(self, name))
            if not np.isfinite(value) or value < 0.0 or (name == "e" and value == 0.0):
                raise InputError(f"{label} {value:g} is not valid: give a number {least}")
            object.__setattr__(self, name, value)
        for name, label in (("A", "contact anisotropy A"), ("F", "force anisotropy F"), ("Ft", "mobilisation F^t")):
            tensor = require_symmetric(label, getattr(self, name), deviatoric=True)
            object.__setattr__(self, name, tensor)
        if np.linalg.eigvalsh(self.A)[0] < -1.0:
            raise InputError(
                "contact anisotropy A has an eigenvalue below -1, for which the density of contact "
                "normals 1 + n.A n is negative: give a smaller A"
            )

    def vector(self) -> np.ndarray:
        """Return the vector (27,) of e, Z, Lambda, the tensors in Mandel notation, and a strain of zero."""
        six = (to_six(self.A), to_six(self.F), to_six(self.Ft), np.zeros(6))
        return np.concatenate([[self.e, self.Z, self.Lam], *six])

    @classmethod
    def from_vector(cls, y: np.ndarray) -> ModelState:
        """Return the ModelState of a vector (27,)."""
        return cls(float(y[0]), float(y[1]), float(y[2]), to_tensor(y[3:9]), to_tensor(y[9:15]), to_tensor(y[15:21]))

    def stress(self, model: Model = TABLE_2) -> np.ndarray:
        """Return the stress according to C0, (3, 3), Pa, compression positive; zero without contacts or forces."""
        return c0_stress(model.young_modulus, self.Z, self.Lam, self.e, self.A, self.F, self.Ft)

    def rotate(self, Q: np.ndarray) -> ModelState:
        """Return the state rotated by the orthogonal tensor Q (3, 3): T -> Q T Q^T."""
        A, F, Ft = (_clean(Q @ tensor @ Q.T) for tensor in (self.A, self.F, self.Ft))
        return dataclasses.replace(self, A=A, F=F, Ft=Ft)


def _clean(tensor: np.ndarray) -> np.ndarray:
    """Return the symmetric deviatoric part of a tensor (3, 3)."""
    tensor = 0.5 * (tensor + tensor.T)
    return tensor - np.trace(tensor) / 3 * np.eye(3)


def state_of(snapshot: Snapshot, fabric: Statistics | None = None) -> ModelState:
    """Return the ModelState with the nominal void ratio and the five statistics of a snapshot; F^t is symmetrised.

    Raises InputError for grains without contacts.

    Args:
        snapshot: The snapshot.
        fabric: The statistics for which the constants of the model are stated (default: those printed, as in Table 2).
            For wide gradings give labkit.micro.statistics_by_volume(snapshot), whose mean stress is exact.
    """
    if len(snapshot.contacts) == 0:
        raise InputError("the grains have no contacts, so that A, F and F^t are undefined: give a denser specimen")
    s = fabric or statistics(snapshot)
    tensors = (s.contact_anisotropy, s.normal_force_anisotropy, s.mobilisation)
    A, F, Ft = (_clean(symmetric(tensor)) for tensor in tensors)
    return ModelState(void_ratio_nominal(snapshot), s.coordination_number, s.mean_normalised_force, A, F, Ft)


def isotropic_state(
    model: Model, void_ratio: float, pressure: float | str, Z: float | None = None, Lam: float | None = None
) -> ModelState:
    """Return an isotropic initial state: A = F = F^t = 0, and C0 requires p = E Z Lambda/(3 (1 + e)) (Eq. 28).

    If neither Z nor Lam is given, Z is on the paper's compression line Z^com(e), to which Eq. 31 brings any
    isotropically compressed specimen, and Lambda follows from p. If one of them is given, the other follows. Beyond
    e_cmax, Z^com is determined by the option beyond_e_cmax. Raises InputError for values that are inconsistent or out
    of range.

    Args:
        model: The model.
        void_ratio: e.
        pressure: Mean stress, Pa, or text with a unit.
        Z: Coordination number.
        Lam: Mean normalised force Lambda.
    """
    if not (np.isfinite(void_ratio) and 0.0 < void_ratio):
        raise InputError(field="void_ratio", value=void_ratio, allowed="a positive number, e.g. 0.67")
    pressure = parameters_of(StressPath)["pressure"].read(pressure) if isinstance(pressure, str) else pressure
    if not (np.isfinite(pressure) and pressure > 0.0):
        raise InputError(field="pressure", value=pressure, allowed="a positive number in Pa, e.g. 0.5e6")
    model.require_density(void_ratio)
    product = 3.0 * pressure * (1.0 + void_ratio) / model.young_modulus  # Z Lambda
    for name, value in (("coordination_number", Z), ("mean_normalised_force", Lam)):
        if value is not None and not (np.isfinite(value) and value > 0.0):
            raise InputError(field=name, value=value, allowed="a positive number")
    if Z is not None and Lam is not None:
        if abs(Z * Lam / product - 1.0) > 1e-6:
            raise InputError(
                f"Z Lambda = {Z * Lam:g} is inconsistent with {pressure:g} Pa at e = {void_ratio:g}, where C0 requires "
                f"{product:g}: give either the coordination number or the mean normalised force, not both"
            )
    elif Lam is not None:
        Z = product / Lam
    else:
        Z = compression_coordination_number(void_ratio, model.constants) if Z is None else Z
        Lam = product / Z
    return ModelState(void_ratio, Z, Lam)


def inherent_anisotropy(a1: float, angle: float) -> np.ndarray:
    """A0 = a1 (n1 n1 - n2 n2/2 - n3 n3/2), with n1 at `angle` (rad) from z in the x-z plane (section 5.3); (3, 3)."""
    axis = np.array([np.sin(angle), 0.0, np.cos(angle)])
    return a1 * (1.5 * np.outer(axis, axis) - 0.5 * np.eye(3))


def with_inherent_anisotropy(model: Model, state: ModelState, a1: float, angle: float) -> ModelState:
    """Return the state with inherent anisotropy A0 of magnitude `a1` at `angle` (rad from z) (section 5.3).

    F0 is chosen so that the stress remains isotropic, and Lambda is adjusted so that the mean stress is unchanged.
    """
    if a1 == 0.0:
        return state
    pressure = np.trace(state.stress(model)) / 3
    A = inherent_anisotropy(a1, angle)
    state = dataclasses.replace(state, A=A, F=isotropic_force_anisotropy(A))
    return dataclasses.replace(state, Lam=state.Lam * pressure / (np.trace(state.stress(model)) / 3))


def isotropic_force_anisotropy(A: np.ndarray, exact: bool = True) -> np.ndarray:
    """Return the F0 (3, 3) for which C0 gives an isotropic stress although A is anisotropic; F^t = 0.

    If `exact`, the deviator of C0's bracket, 2/15 (A + F) + 8/105 dev sym(FA), is set to zero: five linear equations.
    Otherwise F0 is the paper's -A [I + 4/7 A]^-1, which solves the same equations without `dev`; its trace is
    subtracted, because F is deviatoric. With a1 = 0.3 the paper's formula leaves (sigma_1 - sigma_3)/p = 0.0025, the
    exact solution leaves only rounding error.
    """
    A = require_symmetric("contact anisotropy A", A, deviatoric=True)
    if not exact:
        return _clean(-A @ np.linalg.inv(np.eye(3) + 4 / 7 * A))
    basis = deviatoric_basis()
    columns = [to_six(B + 4 / 7 * _clean(symmetric_product(B, A))) for B in basis]
    weights = np.linalg.lstsq(np.stack(columns, axis=1), to_six(-A), rcond=None)[0]
    return np.tensordot(weights, basis, axes=1)


def deviatoric_basis() -> np.ndarray:
    """Return five orthonormal symmetric traceless tensors, (5, 3, 3)."""
    basis = np.zeros((5, 3, 3))
    basis[0] = np.diag([-1.0, -1.0, 2.0]) / np.sqrt(6.0)
    basis[1] = np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    for k, (i, j) in enumerate(((1, 2), (0, 2), (0, 1)), start=2):
        basis[k, i, j] = basis[k, j, i] = np.sqrt(0.5)
    return basis

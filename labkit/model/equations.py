"""C0 to C5 and Eqs. 31 and 32, one function per equation, labelled with its number.

Tensors are six-tuples (labkit.model.tensors); `c` is labkit.model.constants.Constants.
`n` is the direction of the deviatoric strain rate, a unit tensor, and `rate` its norm, 1/s; `volumetric` is the
volumetric strain rate, 1/s, compression positive. Rates of the dimensionless e, Z, Lambda, A, F, F^t are in 1/s.
The functions are defined for e below e_cmax and Lambda > 0: see `outside` in labkit.model.rates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeVar

import numpy as np

from labkit.model.tensors import Six, contract, deviatoric_part, norm, put_six, six_at, six_product, trace
from labkit.sff import c0

if TYPE_CHECKING:
    from labkit.model.constants import Constants

Values = TypeVar("Values", float, np.ndarray)


class CriticalState(Protocol):
    """The parameters of the critical state lines."""

    @property
    def e_cmax(self) -> float:
        """Void ratio at which the critical state has no stress."""

    @property
    def c_cZ(self) -> float:
        """Scale of Z^c - 4."""

    @property
    def gamma_cZ(self) -> float:
        """Exponent of Z^c - 4."""

    @property
    def c_cLam(self) -> float:
        """Slope of Lambda^c."""


def density_distance(e: Values, c: CriticalState) -> Values:
    """e_cmax - e; zero beyond e_cmax, which is reached only with beyond_e_cmax = flat."""
    return np.maximum(c.e_cmax - e, 0.0)


def critical_coordination_number(e: Values, c: CriticalState) -> Values:
    """Z^c = 4 + c_cZ (e_cmax - e)^gamma_cZ."""
    return 4.0 + c.c_cZ * density_distance(e, c) ** c.gamma_cZ


def critical_force(e: Values, c: CriticalState) -> Values:
    """Lambda^c = c_cLambda (e_cmax - e)."""
    return c.c_cLam * density_distance(e, c)


def compression_coordination_number(e: float, c: Constants) -> float:
    """Z^com = 4 + c_com (e_cmax - e)^gamma_cZ, the compression line."""
    return 4.0 + c.c_com * density_distance(e, c) ** c.gamma_cZ


def compression_slope(e: float, c: Constants) -> float:
    """dZ^com/de = -c_com gamma_cZ (e_cmax - e)^(gamma_cZ - 1); zero beyond e_cmax."""
    distance = density_distance(e, c)
    return -c.c_com * c.gamma_cZ * distance ** (c.gamma_cZ - 1.0) if distance > 0.0 else 0.0


def attractor_size(loosest: float, slope: float, e: float, c: Constants) -> float:
    """T_c (1 + T_Z [Z^c - 4]), the norm of an attractor in compression; the slope T_Z is zero in the paper."""
    return loosest * (1.0 + slope * (critical_coordination_number(e, c) - 4.0))


def f_dA(e: float, Lam: float, share: float, c: Constants) -> float:
    """(f^{d,A})^share, f^{d,A} = exp(beta_dA [Lambda^c - Lambda]); share is 1 for A, 1 - F_d for F, Ft_d for F^t."""
    return np.exp(share * c.beta_dA * (critical_force(e, c) - Lam))


def f_eA(Lam: float, c: Constants) -> float:
    """f^{e,A} = c_eA/Lambda^gamma_eA."""
    return c.c_eA / Lam**c.gamma_eA


def f_eF(e: float, Lam: float, c: Constants) -> float:
    """f^{e,F} = [|F^c|/|A^c|] f^{e,A}."""
    return c.F_c / attractor_size(c.A_c, c.A_Z, e, c) * f_eA(Lam, c)


def f_eZ(e: float, Lam: float, c: Constants) -> float:
    """f^{e,Z} = c_eZ exp(beta_eZ [Lambda^c - Lambda])."""
    return c.c_eZ * np.exp(c.beta_eZ * (critical_force(e, c) - Lam))


def f_eLam(e: float, Lam: float, c: Constants) -> float:
    """f^{e,L} = c_eL Lambda^gamma_eL f^{e,Z}; with the reading `distance` |Lambda^c - Lambda|^gamma_eL instead."""
    base = abs(critical_force(e, c) - Lam) if c.distance else Lam
    return c.c_eLam * base**c.gamma_eLam * f_eZ(e, Lam, c)


def compression_gain(e: float, Z: float, c: Constants) -> float:
    """-exp(beta_vZ [Z^com - Z]) dZ^com/de (1 + e); without the minus sign, as in the printed Eq. 31, if as_printed.

    With the reading `parallel` the exponential is at most 1: below the compression line, Z changes parallel to it.
    """
    missing = compression_coordination_number(e, c) - Z
    missing = -np.maximum(-missing, 0.0) if c.parallel else missing
    gain = np.exp(c.beta_vZ * missing) * compression_slope(e, c) * (1.0 + e)
    return gain if c.as_printed else -gain


def f_vZ(e: float, Z: float, Lam: float, compressing: bool, c: Constants) -> float:
    """f^{v,Z} of Eq. 31: -exp(beta_vZ [Z^com - Z]) dZ^com/de (1 + e), or c_vZ/Lambda in dilation.

    Both are positive: contacts form in compression and open in dilation.
    """
    return compression_gain(e, Z, c) if compressing else c.c_vZ / Lam


def f_vLam(e: float, compressing: bool, c: Constants) -> float:
    """f^{v,L} of Eq. 32: c_cL (1 + e), or c_vLd (1 + e) in dilation."""
    return (c.c_cLam if compressing else c.c_vLamd) * (1.0 + e)


def relaxation(stiffness: float, exponent: float, target: Six, T: Six) -> Six:
    """f |T^c - T|^gamma (T^c - T), the form of the right-hand sides of C1 and C3."""
    missing = target - T
    return stiffness * norm(missing) ** exponent * missing


ROOT6 = np.sqrt(6.0)


def lode_direction(n: Six) -> Six:
    """N = sqrt(6) dev(n n), a unit tensor for a unit n; N:n = cos(3 theta), where theta is the Lode angle of n."""
    return ROOT6 * deviatoric_part(six_product(n, n))


def attractor(n: Six, b: float, w: float) -> Six:
    """T^c/T_c = (1 - b) n + b N + w (N - cos(3 theta) n); the paper's n if b = w = 0.

    Its norm is 1 in compression and 1 - 2b in extension; w turns its Lode angle between them.
    """
    N = lode_direction(n)
    return (1.0 - b - w * contract(N, n)) * n + (b + w) * N


def contact_anisotropy_rate(A: Six, e: float, Lam: float, n: Six, rate: float, c: Constants) -> Six:
    """dA/dt = f^{e,A} |f^{d,A} A^c - A|^gamma_A (f^{d,A} A^c - A) |rate| (C1)."""
    size = attractor_size(c.A_c, c.A_Z, e, c)
    target = f_dA(e, Lam, 1.0, c) * size * attractor(n, c.A_b, c.A_w)
    return rate * relaxation(f_eA(Lam, c), c.gamma_A, target, A)


def coordination_number_rate(
    Z: float, e: float, Lam: float, A_rate: Six, rate: float, volumetric: float, compressing: bool, c: Constants
) -> float:
    """dZ/dt = f^{e,Z} (Z^c - Z) |rate| + f^{v,Z} rate_v - c_Z f^{e,Z} |dA/dt| (C2)."""
    shear = critical_coordination_number(e, c) - Z
    return f_eZ(e, Lam, c) * (shear * rate - c.c_Z * norm(A_rate)) + f_vZ(e, Z, Lam, compressing, c) * volumetric


def normal_force_anisotropy_rate(F: Six, e: float, Z: float, Lam: float, n: Six, rate: float, c: Constants) -> Six:
    """dF/dt = f^{e,F} |f^{d,F} F^c - F|^gamma_F (f^{d,F} F^c - F) |rate| (C3), or `elastic_range` if K_F > 0."""
    target = f_dA(e, Lam, 1.0 - c.F_d, c) * c.F_c * attractor(n, c.F_b, c.F_w)
    return rate * (elastic_range(F, e, Z, n, c) if c.K_F > 0.0 else relaxation(f_eF(e, Lam, c), c.gamma_F, target, F))


def size_at(e: float, at_zero: float, slope: float) -> float:
    """|F^c| or |A^c| of Reversals, a straight line in e, at least 0.1."""
    return np.maximum(at_zero + slope * e, 0.1)


def critical_force_anisotropy(e: float, c: Constants) -> float:
    """F_c, the norm of F^c in compression, or the straight line of Reversals if K_F > 0."""
    return size_at(e, c.F_0, c.F_e) if c.K_F > 0.0 else c.F_c


def elastic_range(F: Six, e: float, Z: float, n: Six, c: Constants) -> Six:
    """K_F (Z - Z_F) (n - max(0, F:n)/F_c F/F_c), which replaces the right-hand side of C3 (Reversals)."""
    size = critical_force_anisotropy(e, c)
    share = np.maximum(contract(F, n), 0.0) / (size * size)
    return c.K_F * np.maximum(Z - c.Z_F, 0.0) * (n - share * F)


LENSES = 2.7  # volume of the overlap lenses divided by the volume of the grains and by Z Lambda^2


def line_void_ratio(e: float, Z: float, Lam: float, n: Six, c: Constants) -> float:
    """Void ratio in Z^c, Z^com and Lambda^c: e, or with the reading `reported` e + (1 + e) LENSES Z Lambda^2.

    It is reduced by d_e x^2, x = (1 - cos(3 theta))/2, where theta is the Lode angle of n; this is equivalent to an
    e_cmax increased by d_e x^2.

    The lens of two equal grains has the volume pi D delta^2/4, each grain has Z/2 lenses, and delta/D = 4/3 Lambda. The
    lenses therefore occupy 4/3 Z <Lambda^2> of the grain volume, where <Lambda^2> is about twice <Lambda>^2. LENSES is
    the median over the sheared tests of results/paper; every test is within 0.2 of the median.
    """
    x = 0.5 * (contract(n, n) - contract(lode_direction(n), n))
    e -= c.d_e * x * x
    return e + (1.0 + e) * LENSES * Z * Lam * Lam if c.reported else e


def excess_ratio(A: Six, F: Six, Ft: Six, e: float, n: Six, c: Constants) -> float:
    """(X - X^c):n, where X = 2/5 A + 2/5 F + 3 F^t is s/p in Eq. 30; positive above the critical stress ratio."""
    A_c, Ft_c = attractor_size(c.A_c, c.A_Z, e, c), attractor_size(c.Ft_c, c.Ft_Z, e, c)
    F_c = critical_force_anisotropy(e, c)
    weight = 0.4 * (A_c * c.A_b + F_c * c.F_b) + 3.0 * Ft_c * c.Ft_b
    critical = 0.4 * (A_c + F_c) + 3.0 * Ft_c - weight
    limit = critical * contract(n, n) + weight * contract(lode_direction(n), n)
    return 0.4 * (contract(A, n) + contract(F, n)) + 3.0 * contract(Ft, n) - limit


def mean_force_rate(
    A: Six, e: float, Lam: float, n: Six, rate: float, volumetric: float, compressing: bool, c: Constants
) -> float:
    """dLambda/dt = f^{e,L} (Lambda^c - Lambda) |rate| + f^{v,L} rate_v (C4).

    If K_F > 0 (Reversals), A:n/A_c multiplies the first term.
    """
    factor = Lam if c.with_force else 1.0
    factor = factor * (contract(A, n) / size_at(e, c.A_0, c.A_e) if c.K_F > 0.0 else 1.0)
    shear = f_eLam(e, Lam, c) * factor * (critical_force(e, c) - Lam) * rate
    return shear + f_vLam(e, compressing, c) * volumetric


def mobilisation_rate(Ft: Six, e: float, Lam: float, n: Six, rate: float, c: Constants) -> Six:
    """dF^t/dt = c_M (f^{d,t} F^tc - F^t) |rate| (C5); f^{d,t} is 1 in the paper (f_dA)."""
    size = f_dA(e, Lam, c.Ft_d, c) * attractor_size(c.Ft_c, c.Ft_Z, e, c)
    return c.c_M * rate * (size * attractor(n, c.Ft_b, c.Ft_w) - Ft)


def void_ratio_rate(e: float, volumetric: float) -> float:
    """de/dt = -(1 + e) rate_v, as the grain volume is constant."""
    return -(1.0 + e) * volumetric


component = c0.bracket  # one component of the bracket of C0


def six_bracket(A: Six, F: Six, Ft: Six) -> Six:
    """The bracket of C0 (labkit.sff.c0.bracket) for six-tuples."""
    FA, tr = six_product(F, A), contract(F, A)
    return Six(
        component(1.0, A[0], F[0], tr, FA[0], Ft[0]),
        component(1.0, A[1], F[1], tr, FA[1], Ft[1]),
        component(1.0, A[2], F[2], tr, FA[2], Ft[2]),
        component(0.0, A[3], F[3], tr, FA[3], Ft[3]),
        component(0.0, A[4], F[4], tr, FA[4], Ft[4]),
        component(0.0, A[5], F[5], tr, FA[5], Ft[5]),
    )


def stress_of(y: np.ndarray, c: Constants) -> Six:
    """sigma = E Z Lambda/(1+e) [...] (C0) at y, Pa."""
    return c.E * y[1] * y[2] / (1.0 + y[0]) * six_bracket(six_at(y, 3), six_at(y, 9), six_at(y, 15))


ISOTROPIC = 1e-10  # ratio of deviatoric to total strain rate; below it the direction is only rounding error


def split_rate(D: Six, c: Constants) -> tuple[Six, float, float]:
    """Split a strain rate into (direction n, |rate|, volumetric rate); n is zero if the strain rate is isotropic."""
    deviatoric, total = deviatoric_part(D), norm(D)
    size = norm(deviatoric)
    sheared = size > ISOTROPIC * total
    n = (1.0 / size if sheared else 0.0) * deviatoric
    return n, (total if c.total_rate else (size if sheared else 0.0)), trace(D)


class StateVariables(NamedTuple):
    """The state of the model: e, Z, Lambda, A, F, F^t."""

    e: float
    Z: float
    Lam: float
    A: Six
    F: Six
    Ft: Six


def state_rates(state: StateVariables, D: Six, compressing: bool, c: Constants) -> StateVariables:
    """Rates of the state by C1 to C5 for the strain rate D; `compressing` selects the branch of Eqs. 31 and 32."""
    e, Z, Lam, A, F, Ft = state
    n, rate, volumetric = split_rate(D, c)
    line = line_void_ratio(e, Z, Lam, n, c)
    A_rate = contact_anisotropy_rate(A, line, Lam, n, rate, c)
    Z_rate = coordination_number_rate(Z, line, Lam, A_rate, rate, volumetric, compressing, c)
    Lam_rate = mean_force_rate(A, line, Lam, n, rate, volumetric, compressing, c)
    Lam_rate += c.c_dLam * Lam * excess_ratio(A, F, Ft, line, n, c) * rate if c.c_dLam > 0.0 else 0.0
    F_rate = normal_force_anisotropy_rate(F, line, Z, Lam, n, rate, c)
    Ft_rate = mobilisation_rate(Ft, line, Lam, n, rate, c)
    return StateVariables(void_ratio_rate(e, volumetric), Z_rate, Lam_rate, A_rate, F_rate, Ft_rate)


def strain_driven(y: np.ndarray, D: Six, compressing: bool, c: Constants, out: np.ndarray) -> None:
    """Write the rates of the state vector y (state_rates) to `out` (at least 21,)."""
    state = StateVariables(y[0], y[1], y[2], six_at(y, 3), six_at(y, 9), six_at(y, 15))
    out[0], out[1], out[2], A_rate, F_rate, Ft_rate = state_rates(state, D, compressing, c)
    put_six(out, 3, A_rate)
    put_six(out, 9, F_rate)
    put_six(out, 15, Ft_rate)

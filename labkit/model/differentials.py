"""Differentials of C1 to C5: the change of their right-hand sides with the state and with the strain rate.

Each block is the differential of the equation in its comment, for one direction (dy, dD) at a time; quantities that do
not depend on the direction are computed once. All functions are compiled. The differential of C0 is
equations.stress_rate_of.
"""

from __future__ import annotations

import numpy as np

from labkit.model import equations as eq
from labkit.model.compiled import jit
from labkit.model.parameters import Constants
from labkit.model.rates import STATE, strain_driven
from labkit.model.tensors import (
    Six,
    add,
    contract,
    deviatoric_part,
    multiply,
    norm,
    put_six,
    six_at,
    six_product,
    subtract,
    trace,
)

ISOTROPIC = 1e-10  # deviatoric over total strain rate; below it the direction is rounding error


@jit
def _divide(a, b):
    return a / b if b > 0.0 else 0.0


@jit
def _relaxation(X, dX, size, g, gamma, loss, rate, drate):
    """d(g rate X) of C1 and C3, with X = f A^c - A, |X| = size, g = f^e |X|^gamma and loss = -d(ln f^e)."""
    dg = g * (gamma * _divide(contract(X, dX), size * size) - loss)
    return add(multiply(dg * rate + g * drate, X), multiply(g * rate, dX))


@jit
def _target_differential(f, df, unit, n, N, dn, dcos, size, b, w):
    """d(f T^c) with T^c = size unit, unit of equations.attractor, for df, dn and dcos = d(cos(3 theta))."""
    dN = multiply(2.0 * eq.ROOT6, deviatoric_part(six_product(n, dn)))
    along = add(multiply(1.0 - b - w * contract(N, n), dn), multiply(-w * dcos, n))
    return multiply(size, add(multiply(df, unit), multiply(f, add(along, multiply(b + w, dN)))))


@jit
def _excess_differential(A, dA, F, dF, Ft, dFt, n, dn, dcos, c):
    """d((X - X^c):n) of the amendment to C4."""
    weight = 0.4 * (c.A_c * c.A_b + c.F_c * c.F_b) + 3.0 * c.Ft_c * c.Ft_b
    change = 0.4 * (contract(dA, n) + contract(A, dn) + contract(dF, n) + contract(F, dn))
    return change + 3.0 * (contract(dFt, n) + contract(Ft, dn)) - weight * dcos


@jit
def _line_differential(y, e, n, N, dy, dcos, c):
    """Differential of the void ratio of the lines (equations.line_void_ratio); e: without the overlap lenses."""
    de = dy[0] + 0.5 * c.d_e * (contract(n, n) - contract(N, n)) * dcos
    if not c.reported:
        return de
    Z, Lam = y[1], y[2]
    return de + eq.LENSES * Lam * (de * Z * Lam + (1.0 + e) * (Lam * dy[1] + 2.0 * Z * dy[2]))


@jit
def _line_slopes(e, c):
    """(d2 Z^com/de2, dZ^c/de, dLambda^c/de); zero beyond e_cmax."""
    distance = eq.density_distance(e, c)
    if distance <= 0.0:
        return 0.0, 0.0, 0.0
    Z_c_slope = -c.c_cZ * c.gamma_cZ * distance ** (c.gamma_cZ - 1.0)
    return c.c_com * c.gamma_cZ * (c.gamma_cZ - 1.0) * distance ** (c.gamma_cZ - 2.0), Z_c_slope, -c.c_cLam


@jit
def _stiffness_differential(Lam, dLam, missing, dmissing, c):
    """d(ln f^{e,L}) without the part of f^{e,Z}: of Lambda^gamma, or of |Lambda^c - Lambda|^gamma."""
    if c.distance:
        return c.gamma_eLam * (dmissing / missing if missing != 0.0 else 0.0)
    return c.gamma_eLam * dLam / Lam


@jit
def _volumetric_differential(fvZ, e, de, dZ, Lam, dLam, slope, curvature, compressing, c):
    """d f^{v,Z} of Eq. 31."""
    if not compressing:
        return -fvZ / Lam * dLam
    if slope == 0.0:  # beyond e_cmax
        return 0.0
    return fvZ * (c.beta_vZ * (slope * de - dZ) + curvature / slope * de + de / (1.0 + e))


@jit
def _add_one_sided(y, dev, compressing, c, row):
    """Add the mean of the two one-sided derivatives of |rate| in the direction `dev` to a row."""
    forward, backward = np.empty(STATE + 6), np.empty(STATE + 6)
    strain_driven(y, dev, compressing, c, forward)
    strain_driven(y, multiply(-1.0, dev), compressing, c, backward)
    for i in range(1, STATE):
        row[i] += 0.5 * (forward[i] - backward[i])


@jit
def rates_differentials(
    y: np.ndarray, D: Six, compressing: bool, c: Constants, dy: np.ndarray, dD: np.ndarray, out: np.ndarray
) -> None:
    """Write d(dy/dt) to `out` (m, 21) for the m rows of dy (m, 21) and dD (m, 6), at state y (21,) and strain rate D.

    Where D is isotropic, |rate| is not differentiable. The mean of the two one-sided derivatives is used; terms that
    are the same for a deviatoric strain rate and its opposite have opposite signs in the two, so they cancel.
    """
    Z, Lam, A, F, Ft = y[1], y[2], six_at(y, 3), six_at(y, 9), six_at(y, 15)
    n, rate, volumetric = eq.split_rate(D, c)
    size = norm(deviatoric_part(D))
    isotropic = size <= ISOTROPIC * norm(D)
    if isotropic:
        n, rate = multiply(0.0, n), (rate if c.total_rate else 0.0)
    N = eq.lode_direction(n)
    e, without = eq.line_void_ratio(y[0], Z, Lam, n, c), eq.line_void_ratio(y[0], 0.0, 0.0, n, c)
    Zc, Lamc, slope = eq.critical_coordination_number(e, c), eq.critical_force(e, c), eq.compression_slope(e, c)
    curvature, Z_c_slope, Lam_c_slope = _line_slopes(e, c)
    fd, feA, feF, feZ = eq.f_dA(e, Lam, c), eq.f_eA(Lam, c), eq.f_eF(Lam, c), eq.f_eZ(e, Lam, c)
    feLam, fvZ, fvLam = eq.f_eLam(e, Lam, c), eq.f_vZ(e, Z, Lam, compressing, c), eq.f_vLam(e, compressing, c)
    A_n, F_n, Ft_n = eq.attractor(n, c.A_b, c.A_w), eq.attractor(n, c.F_b, c.F_w), eq.attractor(n, c.Ft_b, c.Ft_w)
    XA, XF = subtract(multiply(fd * c.A_c, A_n), A), subtract(multiply(fd * c.F_c, F_n), F)
    mA, mF = norm(XA), norm(XF)
    gA, gF = feA * mA**c.gamma_A, feF * mF**c.gamma_F
    A_rate = multiply(gA * rate, XA)
    A_size = norm(A_rate)
    force = Lam if c.with_force else 1.0
    excess = eq.excess_ratio(A, F, Ft, n, c)
    for k in range(dD.shape[0]):
        dZ, dLam = dy[k, 1], dy[k, 2]
        dA, dF, dFt, dDk = six_at(dy[k], 3), six_at(dy[k], 9), six_at(dy[k], 15), six_at(dD[k], 0)
        dev, dvol = deviatoric_part(dDk), trace(dDk)
        along = 0.0 if isotropic else contract(n, dev)
        dn = multiply(0.0 if isotropic else 1.0 / size, subtract(dev, multiply(along, n)))
        dcos = 3.0 * contract(N, dn)
        de = _line_differential(y, without, n, N, dy[k], dcos, c)
        drate = _divide(contract(D, dDk), norm(D)) if c.total_rate else along
        dLamc, dZc = Lam_c_slope * de, Z_c_slope * de
        dfd = c.beta_dA * fd * (dLamc - dLam)
        dfeZ = c.beta_eZ * feZ * (dLamc - dLam)
        # C1
        dX = subtract(_target_differential(fd, dfd, A_n, n, N, dn, dcos, c.A_c, c.A_b, c.A_w), dA)
        dA_rate = _relaxation(XA, dX, mA, gA, c.gamma_A, c.gamma_eA * dLam / Lam, rate, drate)
        # C3
        dX = subtract(_target_differential(fd, dfd, F_n, n, N, dn, dcos, c.F_c, c.F_b, c.F_w), dF)
        dF_rate = _relaxation(XF, dX, mF, gF, c.gamma_F, c.gamma_eA * dLam / Lam, rate, drate)
        # C5
        missing = subtract(multiply(c.Ft_c, Ft_n), Ft)
        dmissing = subtract(_target_differential(1.0, 0.0, Ft_n, n, N, dn, dcos, c.Ft_c, c.Ft_b, c.Ft_w), dFt)
        dFt_rate = multiply(c.c_M, add(multiply(drate, missing), multiply(rate, dmissing)))
        # 31, 32
        dfvZ = _volumetric_differential(fvZ, e, de, dZ, Lam, dLam, slope, curvature, compressing, c)
        dfvLam = fvLam / (1.0 + e) * de
        # C2
        dA_size = _divide(contract(A_rate, dA_rate), A_size)
        dZ_rate = (
            dfeZ * ((Zc - Z) * rate - c.c_Z * A_size)
            + feZ * ((dZc - dZ) * rate + (Zc - Z) * drate - c.c_Z * dA_size)
            + dfvZ * volumetric
            + fvZ * dvol
        )
        # C4
        dfeLam = feLam * (_stiffness_differential(Lam, dLam, Lamc - Lam, dLamc - dLam, c) + dfeZ / feZ)
        dforce = dLam if c.with_force else 0.0
        dLam_rate = (
            (dfeLam * force + feLam * dforce) * (Lamc - Lam) * rate
            + feLam * force * ((dLamc - dLam) * rate + (Lamc - Lam) * drate)
            + dfvLam * volumetric
            + fvLam * dvol
        )
        if c.c_dLam > 0.0:
            dexcess = _excess_differential(A, dA, F, dF, Ft, dFt, n, dn, dcos, c)
            dLam_rate += c.c_dLam * (dLam * excess * rate + Lam * (dexcess * rate + excess * drate))
        row = out[k]
        row[0], row[1], row[2] = -(1.0 + y[0]) * dvol - dy[k, 0] * volumetric, dZ_rate, dLam_rate
        put_six(row, 3, dA_rate)
        put_six(row, 9, dF_rate)
        put_six(row, 15, dFt_rate)
        if isotropic and not c.total_rate:
            _add_one_sided(y, dev, compressing, c, row)

"""The model for coaxial triaxial states: a second implementation in zz components with the numbers of Table 2."""

import numpy as np


def scalar_rates(e, Z, Lam, a, f, t, axial, radial):
    """d(e, Z, Lambda, A_zz, F_zz, F^t_zz)/dt for axial and radial strain rates."""
    s = 2 / 3 * (axial - radial)  # deviatoric strain rate, zz
    v = axial + 2 * radial
    rate = np.sqrt(1.5) * abs(s)
    sign = np.sign(s)
    Lam_c, Z_c = 0.098 * (0.76 - e), 4 + 5.57 * (0.76 - e) ** 0.7
    fd = np.exp(35 * (Lam_c - Lam))
    XA, XF = sign * fd * 0.45 - a, sign * fd * 0.77 - f
    a_rate = 1.0 / Lam**0.65 * (np.sqrt(1.5) * abs(XA)) ** 0.4 * XA * rate
    f_rate = 0.77 / 0.45 * 1.0 / Lam**0.65 * (np.sqrt(1.5) * abs(XF)) ** 0.2 * XF * rate
    feZ = 4.96 * np.exp(70 * (Lam_c - Lam))
    if v > 0:
        Zcom = 4 + 7.2 * (0.76 - e) ** 0.7
        fvZ = np.exp(3 * (Zcom - Z)) * 7.2 * 0.7 * (0.76 - e) ** -0.3 * (1 + e)
    else:
        fvZ = 0.3 / Lam
    Z_rate = feZ * (Z_c - Z) * rate + fvZ * v - 0.125 * feZ * np.sqrt(1.5) * abs(a_rate)
    Lam_rate = 100 * Lam**0.65 * feZ * (Lam_c - Lam) * rate + (0.098 if v > 0 else 0.075) * (1 + e) * v
    t_rate = 100 * (sign * 0.045 - t) * rate
    return np.array([-(1 + e) * v, Z_rate, Lam_rate, a_rate, f_rate, t_rate])


def scalar_stress(e, Z, Lam, a, f, t):
    """(p, q) of C0, Pa: A = a diag(-1/2, -1/2, 1) and so on."""
    scale = 0.15e9 * Z * Lam / (1 + e)
    trace = 1.5 * f * a  # tr(FA)
    mean = 1 / 3 + 2 / 105 * trace + 8 / 105 * trace / 3
    axial = 1 / 3 + 2 / 15 * (a + f) + 2 / 105 * trace + 8 / 105 * f * a + t
    radial = 1 / 3 - 1 / 15 * (a + f) + 2 / 105 * trace + 8 / 105 * f * a / 4 - t / 2
    return scale * mean, scale * (axial - radial)

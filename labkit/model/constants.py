"""The constants of the model, in the form that compiled code reads."""

from __future__ import annotations

from typing import NamedTuple


class Constants(NamedTuple):
    """Constants for compiled code: E (Pa), Parameters, c_dLam, LodeDependence, DensityDependence, Reversals, flags.

    A flag is True if the interpretation (Readings) after which it is named applies. The values come from
    `Model.constants`, which raises TypeError if the names of these fields do not match the parameters of the model.
    """

    E: float
    e_cmax: float
    c_cZ: float
    gamma_cZ: float
    c_cLam: float
    A_c: float
    F_c: float
    Ft_c: float
    c_eA: float
    gamma_eA: float
    beta_dA: float
    gamma_A: float
    c_eZ: float
    beta_eZ: float
    c_Z: float
    c_com: float
    c_vZ: float
    beta_vZ: float
    gamma_F: float
    gamma_eLam: float
    c_eLam: float
    c_vLamd: float
    c_M: float
    c_dLam: float
    A_b: float
    A_w: float
    F_b: float
    F_w: float
    Ft_b: float
    Ft_w: float
    d_e: float
    A_Z: float
    Ft_Z: float
    F_d: float
    Ft_d: float
    K_F: float
    Z_F: float
    F_0: float
    F_e: float
    A_0: float
    A_e: float
    total_rate: bool
    with_force: bool
    distance: bool
    as_printed: bool
    flat: bool
    reported: bool
    parallel: bool

"""Nine stress-force-fabric equations, which approximate Love's stress to different orders (sections 3, 4).

`stress(form, snapshot)` evaluates each of them.

| form | order of normals and normal force | order of tangential force | treatment of grain size |
|---|---|---|---|
| `classical` (Eq. 12) | 2, fitted to f | 2, fitted to f | one mean diameter |
| `classical_groups` (Eq. 16) | as `classical`, in each size group | | sum of Eq. 15 |
| `linear` (Eqs. 28-30) | 2, without the product of A and F | 0 | f~ |
| `c0` (C0) | 2 | 0 | f~ |
| `c0_tangential` | 2 | 2 | f~ |
| `c0_volume` | 2 | 0 | l f over the mean grain volume |
| `c0_groups` | C0 in each size group | | sum of Eq. 17 |
| `c0_fourth` | 4 | 0 | f~ |
| `fourth` | 4 | 2 | l f over the mean grain volume |

f~ assumes that grains of all sizes carry the same stress (below Eq. 19). The average of l f over the mean grain volume,
taken over all contact sides, equals Love's stress without that assumption (Eq. 17 with a single group).

The forces are divided by the density of contact normals. In strongly anisotropic snapshots, such as rods in extension,
the density of fourth order comes near zero in some directions; the forms of fourth order may then err by 10 % and more.

For clumps the forms whose names contain `c0` or `fourth` include the terms M - X of eccentric contacts
(labkit.micro.eccentricity); the classical and linear forms are those of spheres.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from labkit.errors import InputError, instead_of
from labkit.micro.contact_sides import Vectors, mean_volume, vectors_of_contacts, vectors_of_sides
from labkit.micro.fabric import Series, series_of
from labkit.micro.size_groups import diameter_edges, groups_by_diameter
from labkit.micro.snapshot import Snapshot, contact_arms
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.sff.c0 import IDENTITY, bracket, symmetric_product

GROUPS = 5


def product_integral(
    A: np.ndarray, F: np.ndarray, A4: np.ndarray | None = None, F4: np.ndarray | None = None
) -> np.ndarray:
    """Return the mean of (1 + n.A n + A4::nnnn) (1 + n.F n + F4::nnnn) n n over the sphere, shape (3, 3).

    The mean is I/3 + 2/15 (A + F) + 2/105 tr(FA) I + 8/105 sym(FA), the normal part of C0. Fourth-order terms add
    8/315 (A4:F + F4:A) + 8/3465 (A4::F4) I + 64/3465 sym(A4_iklm F4_jklm). A, F (3, 3); A4, F4 (3, 3, 3, 3).
    """
    FA = symmetric_product(F, A)
    value = bracket(IDENTITY, A, F, np.trace(FA), FA, 0.0)
    if A4 is not None and F4 is not None:
        both = np.einsum("iklm,jklm->ij", A4, F4)
        value = value + 8 / 315 * (np.einsum("ijkl,kl->ij", A4, F) + np.einsum("ijkl,kl->ij", F4, A))
        value = value + 8 / 3465 * np.trace(both) * IDENTITY + 32 / 3465 * (both + both.T)
    return value


def tangential_coupling(A: np.ndarray, Ft: np.ndarray, A4: np.ndarray | None = None) -> np.ndarray:
    """Return the correction to F^t for anisotropic contact normals, which C0 neglects; shape (3, 3).

    F^t is the mean of n (x) t over the sphere with uniform weight, t = -Lambda_t/Lambda. To lowest order
    t = G n - (n.G n) n + W n with G = 5 sym(F^t) and W = 3 skew(F^t)^T. The mean with the additional weight
    n.A n + A4::nnnn is 2/3 A S - 2/21 tr(AS) I - 8/21 sym(AS) + 2/5 A K - 8/63 A4:S with S = sym(F^t) and
    K = skew(F^t).
    """
    S, K = 0.5 * (Ft + Ft.T), 0.5 * (Ft - Ft.T)
    product = symmetric_product(A, S)
    value = 2 / 3 * A @ S - 2 / 21 * np.trace(product) * IDENTITY - 8 / 21 * product + 2 / 5 * A @ K
    return value if A4 is None else value - 8 / 63 * np.einsum("ijkl,kl->ij", A4, S)


def sphere_integral(series: Series, tangential: int) -> np.ndarray:
    """Return the integral of Eq. 22 over a Series, (3, 3): Lambda times the bracket of C0 or a higher-order analogue.

    For grains that are not spheres it includes M - X. The order of the tangential term, `tangential`, is 0 (only F^t)
    or 2.
    """
    density, force = series.density, series.normal_force
    fourth = density.fourth if density.fourth.any() else None
    value = product_integral(density.second, force.second, fourth, force.fourth) + series.mobilisation
    if tangential == 2:
        value = value + tangential_coupling(density.second, series.mobilisation, fourth)
    if series.eccentricity is not None:
        value = value + series.eccentricity[0] - series.eccentricity[1]
    return force.mean * value


def scale_of(snapshot: Snapshot) -> float:
    """Return the factor E Z/(1 + e) with the nominal void ratio, Pa."""
    Z = 2 * len(snapshot.contacts) / snapshot.number_of_grains
    return snapshot.young_modulus * Z / (1.0 + void_ratio_nominal(snapshot))


def _normalised_form(order, tangential, grain_volume=lambda snapshot: None):
    """Return a function that evaluates E Z/(1 + e) Lambda [...] to these orders, with `grain_volume` in f~."""

    def stress_of(snapshot):
        series = series_of(vectors_of_contacts(snapshot, grain_volume(snapshot)), order)
        return scale_of(snapshot) * sphere_integral(series, tangential)

    return stress_of


def _linear(snapshot):
    """Eqs. 28, 29: E Z Lambda/(1 + e) [I/3 + 2/15 A + 2/15 F + F^t], which is C0 without the product FA."""
    series = series_of(vectors_of_contacts(snapshot), 2)
    A, F, Lam = series.density.second, series.normal_force.second, series.normal_force.mean
    return scale_of(snapshot) * Lam * bracket(IDENTITY, A, F, 0.0, 0.0, series.mobilisation)


def _classical(snapshot, side):
    """Eq. 12 for the selected sides (n, 2): N_c D f/(6V) [I + 2/5 (A + G^n + 3/2 G^t)].

    The paper prints 3V, which holds if N_c counts each contact once. The paper's N_c counts both sides, so the
    denominator is 6V. D is the mean of 2|l|, and f is the directional mean of f_n over the sides.
    3/2 G^t = 15/2 F^t, where F^t is Eq. 27 evaluated with f.
    """
    contacts = snapshot.contacts
    row, _ = np.nonzero(side)
    D = 2.0 * contact_arms(snapshot)[side].mean()
    series = series_of(Vectors(contacts.normal[row], contacts.normal_force[row], contacts.tangential_force[row]), 2)
    A, normal, tangential = series.density.second, series.normal_force.second, 5.0 * series.mobilisation
    scale = len(row) * D * series.normal_force.mean / (6.0 * snapshot.volume)
    return scale * (IDENTITY + 0.4 * (A + normal + 1.5 * tangential))


def _classical_whole(snapshot):
    return _classical(snapshot, np.ones((len(snapshot.contacts), 2), dtype=bool))


def _classical_groups(snapshot, group):
    """Eq. 16: sum of the classical forms of all groups, whose numbers of contacts already contain N_c(k)/N_c."""
    return sum(_classical(snapshot, side) for _, side in _sides_of_groups(snapshot, group))


def _c0_groups(snapshot, group):
    """Eq. 17 with C0 in each group; f~ contains the mean grain volume of the group."""
    solid, E = 4.0 / 3.0 * np.pi * snapshot.radius**3, snapshot.young_modulus
    total = np.zeros((3, 3))
    for k, side in _sides_of_groups(snapshot, group):
        inside = group == k
        vectors = vectors_of_sides(snapshot, side, np.full(len(solid), solid[inside].mean()))
        weight = E * len(vectors) / inside.sum() * solid[inside].sum() / snapshot.volume  # E Z/(1+e) Z(k)/Z V_g(k)/V_g
        total = total + weight * sphere_integral(series_of(vectors, 2), 0)
    return total


def _sides_of_groups(snapshot, group):
    """Yield (k, sides (n, 2) of bool) for every group with contacts."""
    of_side = group[snapshot.contacts.grain]
    for k in np.unique(of_side):
        yield k, of_side == k


FORMS: dict[str, Callable[..., np.ndarray]] = {
    "classical": _classical_whole,
    "classical_groups": _classical_groups,
    "linear": _linear,
    "c0": _normalised_form(2, 0),
    "c0_tangential": _normalised_form(2, 2),
    "c0_volume": _normalised_form(2, 0, mean_volume),
    "c0_groups": _c0_groups,
    "c0_fourth": _normalised_form(4, 0),
    "fourth": _normalised_form(4, 2, mean_volume),
}


def stress(form: str, snapshot: Snapshot, group: np.ndarray | None = None) -> np.ndarray:
    """Return the stress (3, 3) in Pa by one of FORMS, compression positive; zero without contacts or forces.

    Raises InputError if the form is unknown.

    Args:
        form: Name of the equation, one of FORMS.
        snapshot: The snapshot.
        group: Index of the size group of each grain, (grain,), for the forms whose names end in `_groups` (default:
            five equal intervals of the diameter).
    """
    if form not in FORMS:
        raise InputError(f"the form {form!r} is unknown: use {instead_of(FORMS, form)}")
    if len(snapshot.contacts) == 0 or not snapshot.contacts.normal_force.any():
        return np.zeros((3, 3))
    if not form.endswith("_groups"):
        return FORMS[form](snapshot)
    if group is None:
        group = groups_by_diameter(snapshot, diameter_edges(snapshot, GROUPS))
    return FORMS[form](snapshot, np.asarray(group))

"""The equations of the study, the errors of a snapshot, and what is left in the deviator of the equation by volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas
from scipy.integrate import lebedev_rule

import labkit as lk
from labkit.micro import (
    Vectors,
    along_deviator,
    equivalent_stress,
    mean_volume,
    normal_density,
    statistics_by_volume,
    traceless,
    vectors_of_contacts,
)
from labkit.sff import stress, tangential_coupling

FORMS = ("c0", "c0_volume", "fourth", "entropy2", "entropy4")
REMAINING = ("force order 4", "tangential order 2", "tangential order 4")
POINTS, WEIGHTS = (lambda rule: (rule[0].T, rule[1] / rule[1].sum()))(lebedev_rule(29))
PAIRS = ((0, 0), (1, 1), (0, 1), (1, 2), (2, 0))
STEPS, TOLERANCE = 60, 1e-10


def polynomials(n: np.ndarray, order: int) -> np.ndarray:
    """Even polynomials up to `order` (2 or 4) that are independent on the sphere, at unit vectors (m, 3), (m, k)."""
    x, y, z = n.T
    second = [x * x - 1 / 3, y * y - 1 / 3, x * y, y * z, z * x]
    if order == 2:
        return np.stack([np.ones(len(n)), *second], axis=1)
    fourth = [x**4, y**4, x**2 * y**2, x**3 * y, x * y**3, x**3 * z, x * z**3, y**3 * z, y * z**3]
    return np.stack([np.ones(len(n)), *second, *fourth], axis=1)


def greatest_entropy(moments: np.ndarray, order: int) -> np.ndarray:
    """Values at POINTS of exp(polynomial) whose means with `polynomials` are the moments; NaN if there is none.

    Newton's method with halved steps on the convex function log-sum of exponents.
    """
    basis = polynomials(POINTS, order)
    target, at = moments / moments[0], np.zeros(basis.shape[1] - 1)
    basis = basis[:, 1:]

    def potential(coefficients: np.ndarray) -> float:
        exponent = basis @ coefficients
        return float(np.log(WEIGHTS @ np.exp(exponent - exponent.max())) + exponent.max() - coefficients @ target[1:])

    for _ in range(STEPS):
        exponent = basis @ at
        density = WEIGHTS * np.exp(exponent - exponent.max())
        density /= density.sum()
        mean = density @ basis
        gradient = mean - target[1:]
        if np.abs(gradient).max() < TOLERANCE:
            return moments[0] * density / WEIGHTS
        step = np.linalg.lstsq((basis - mean).T @ (density[:, None] * (basis - mean)), gradient, rcond=None)[0]
        size, before = 1.0, potential(at)
        while size > 1e-6 and not potential(at - size * step) <= before - 1e-4 * size * float(gradient @ step):
            size *= 0.5
        at = at - size * step
    return np.full(len(POINTS), np.nan)


def by_entropy(vectors: Vectors, order: int) -> np.ndarray:
    """Mean of n (x) Lambda over all contacts by a positive density, (3, 3); NaN if no such density has the moments.

    The weighted normal force Lambda_n/(1 + n.A n) is the function of greatest entropy with the moments to this order
    that the contacts give: to second order those are Lambda and F. Its mean with 1 + n.A n is the normal part.
    """
    n = vectors.normal
    density = normal_density(n)
    weighted = vectors.normal_component / density.shape(n)
    g = greatest_entropy((polynomials(n, order) * weighted[:, None]).mean(axis=0), order)
    normal = np.einsum("m,mi,mj->ij", WEIGHTS * g * density.shape(POINTS), POINTS, POINTS)
    h = -(n.T @ (vectors.tangential / density.shape(n)[:, None])) / len(n)
    return normal + h + tangential_coupling(density.second, h)


def stress_by_entropy(snapshot: lk.Snapshot, order: int) -> np.ndarray:
    """Stress by `by_entropy` with the mean grain volume, Pa, (3, 3), with the terms of eccentric contacts."""
    vectors = vectors_of_contacts(snapshot, mean_volume(snapshot))
    value = by_entropy(vectors, order)
    if vectors.eccentric is not None:
        of_normal, of_tangential = vectors.eccentric.mean(axis=1)
        value = value + of_normal - of_tangential
    solid = 4.0 / 3.0 * np.pi * float((snapshot.radius**3).mean())
    return 2.0 * len(snapshot.contacts) * solid / snapshot.volume * snapshot.young_modulus * value


def remaining(snapshot: lk.Snapshot) -> dict[str, np.ndarray]:
    """Terms that the equation by volume neglects, REMAINING -> (3, 3), Pa; equation + their sum is Love's stress."""
    vectors = vectors_of_contacts(snapshot, mean_volume(snapshot))
    n, density = vectors.normal, normal_density(vectors.normal)
    shape = density.shape(n)
    A = density.second
    weighted = vectors.normal_component / shape
    fourth = traceless(np.einsum("m,mi,mj,mk,ml->ijkl", weighted / len(n), n, n, n, n, optimize=True))
    h = -(n.T @ (vectors.tangential / shape[:, None])) / len(n)
    whole = -(n.T @ (vectors.tangential * ((shape - 1.0) / shape)[:, None])) / len(n)
    second = tangential_coupling(A, h)
    solid = 4.0 / 3.0 * np.pi * float((snapshot.radius**3).mean())
    scale = 2.0 * len(snapshot.contacts) * solid / snapshot.volume * snapshot.young_modulus
    parts = np.einsum("ijkl,kl->ij", fourth, A), second, whole - second
    return {name: scale * part for name, part in zip(REMAINING, parts, strict=True)}


def of_snapshot(snapshot: lk.Snapshot) -> dict[str, float]:
    """Stress, errors of the equations in p and q, terms that remain in q, and Lambda of a snapshot."""
    love = lk.love_stress(snapshot)
    p, q = float(lk.mean_stress(love)), float(equivalent_stress(love))
    stresses = {form: stress(form, snapshot) for form in FORMS[:3]}
    stresses |= {f"entropy{order}": stress_by_entropy(snapshot, order) for order in (2, 4)}
    printed, by_volume = lk.statistics(snapshot), statistics_by_volume(snapshot)
    errors = {form: value - love for form, value in stresses.items()}
    return {
        "p": p,
        "q/p": q / p,
        "Z": printed.coordination_number,
        "Lambda": printed.mean_normalised_force,
        "Lambda by volume": by_volume.mean_normalised_force,
        "A": float(along_deviator(printed.contact_anisotropy, love)),
        "F": float(along_deviator(printed.normal_force_anisotropy, love)),
        "F by volume": float(along_deviator(by_volume.normal_force_anisotropy, love)),
        "Ft": float(along_deviator(printed.mobilisation, love)),
        "Ft by volume": float(along_deviator(by_volume.mobilisation, love)),
        **{f"{form} q": float(along_deviator(error, love)) / q for form, error in errors.items()},
        **{f"{form} p": float(lk.mean_stress(error)) / p for form, error in errors.items()},
        **{f"remaining {name}": float(along_deviator(part, love)) / q for name, part in remaining(snapshot).items()},
    }


def snapshots(file: Path) -> pandas.DataFrame:
    """A row for each snapshot of a run but the first: test, shape, grading, seed, strain and `of_snapshot`."""
    test, shape, grading, seed = file.name.removesuffix(".run.nc").split("-")
    with lk.open_run(file) as run:
        strain = np.abs(run.lab.strain().values[run["record"].values])
        rows = [of_snapshot(one) for one in run.lab.snapshots(range(1, run.lab.number_of_snapshots))]
        checks = {
            "inertial_number": float(run["inertial_number"].max()),
            "energy_balance": float(np.abs(run["energy_balance_error"]).max()),
            "bodies": len(run.lab.body_radius),
        }
    first = {"test": test, "shape": shape, "grading": grading.replace("_", " "), "seed": int(seed.removeprefix("s"))}
    table = pandas.DataFrame(rows).assign(**first, strain=np.round(strain[1:], 4), **checks)
    return table[[*first, "strain", *(name for name in table if name not in (*first, "strain"))]]

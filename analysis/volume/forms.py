"""The equations of the study, the errors of a snapshot, and what the equation by volume neglects in q."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas
from scipy.integrate import lebedev_rule

import labkit as lk
from labkit.micro import (
    along_deviator,
    equivalent_stress,
    mean_volume,
    normal_density,
    statistics_by_volume,
    vectors_of_contacts,
    void_ratio_nominal,
)
from labkit.sff import NEGLECTED, neglected_terms, stress, tangential_coupling

FORMS = ("c0", "c0_volume", "fourth", "entropy2", "c0_volume + 2")
CLOSURES = FORMS[2:]
POINTS, WEIGHTS = (lambda rule: (rule[0].T, rule[1] / rule[1].sum()))(lebedev_rule(29))
STEPS, TOLERANCE = 60, 1e-10


def polynomials(n: np.ndarray) -> np.ndarray:
    """The even polynomials of second order that are independent on the sphere, at unit vectors (m, 3), (m, 6)."""
    x, y, z = n.T
    return np.stack([np.ones(len(n)), x * x - 1 / 3, y * y - 1 / 3, x * y, y * z, z * x], axis=1)


def greatest_entropy(moments: np.ndarray) -> np.ndarray:
    """Values at POINTS of exp(polynomial) whose means with `polynomials` are the moments; NaN if there is none.

    Newton's method with halved steps on the convex function log-sum of exponents.
    """
    basis = polynomials(POINTS)
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


def stress_by_entropy(snapshot: lk.Snapshot) -> np.ndarray:
    """Stress by `entropy2`, Pa, (3, 3): a positive closure with the variables of C0; NaN if there is none.

    The weighted normal force g = Lambda_n/(1 + n.A n) is the function of greatest entropy with the moments Lambda and
    F; the tangential force has second order. Clumps add M - X.
    """
    vectors, fabric = vectors_of_contacts(snapshot, mean_volume(snapshot)), statistics_by_volume(snapshot)
    n, density = vectors.normal, normal_density(vectors.normal)
    weighted = vectors.normal_component / density.shape(n)
    g = greatest_entropy((polynomials(n) * weighted[:, None]).mean(axis=0))
    normal = np.einsum("m,mi,mj->ij", WEIGHTS * g * density.shape(POINTS), POINTS, POINTS)
    tangential = fabric.mobilisation + tangential_coupling(fabric.contact_anisotropy, fabric.mobilisation)
    if fabric.eccentricity is not None:
        tangential = tangential + fabric.eccentricity
    scale = snapshot.young_modulus * fabric.coordination_number / (1.0 + void_ratio_nominal(snapshot))
    return scale * (normal + fabric.mean_normalised_force * tangential)


def of_snapshot(snapshot: lk.Snapshot) -> dict[str, float]:
    """Stress, errors of the equations in p and q, terms neglected in q, and Lambda of a snapshot."""
    love = lk.love_stress(snapshot)
    p, q = float(lk.mean_stress(love)), float(equivalent_stress(love))
    stresses = {form: stress(form, snapshot) for form in FORMS[:3]}
    neglected = neglected_terms(snapshot)
    stresses["entropy2"] = stress_by_entropy(snapshot)
    stresses["c0_volume + 2"] = stresses["c0_volume"] + neglected["normal_4"] + neglected["tangential_2"]
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
        **{f"neglected {name}": float(along_deviator(neglected[name], love)) / q for name in NEGLECTED},
    }


def snapshots(file: Path, labels: Sequence[str]) -> pandas.DataFrame:
    """A row for each snapshot of a run but the first: its labels in the file name, strain, `of_snapshot` and checks."""
    first = dict(zip(labels, file.name.removesuffix(".run.nc").replace("_", " ").split("-"), strict=True))
    with lk.open_run(file) as run:
        strain = np.abs(run.lab.strain().values[run["record"].values])
        rows = [of_snapshot(one) for one in run.lab.snapshots(range(1, run.lab.number_of_snapshots))]
        checks = {
            "inertial_number": float(run["inertial_number"].max()),
            "energy_balance": float(np.abs(run["energy_balance_error"]).max()),
            "bodies": len(run.lab.body_radius),
        }
    first |= {"seed": first["seed"].removeprefix("s")}
    return pandas.DataFrame(
        [first | {"strain": round(at, 4)} | row | checks for at, row in zip(strain[1:], rows, strict=True)]
    )

"""The forms of C0 for clumps, and what the study keeps of a snapshot of a run."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas

import labkit as lk
from labkit.micro import (
    along_deviator,
    axis_anisotropy,
    branch_anisotropy,
    contact_arms,
    contacts_per_pair,
    equivalent_stress,
    normal_force_eccentricity,
    void_ratio_nominal,
)
from labkit.sff import c0_stress, error_budget, stress

FORMS = ("printed", "l.n", "M", "M - X", "G")
UNPLANNED = ("c0_volume", "fourth", "fourth, l.n")  # of labkit.sff.FORMS with M - X, the last without
CANCELLING = [f"budget {part}" for part in ("normals", "normal_forces", "tangential_forces", "sampling")]  # in p
DIRECTION = 2  # snapshot from which the stress has the direction of its test; the fabric before is taken along it
SHEARED = {"compression": 1.0, "extension": 1.0, "shear": 0.5}  # factor from the strain of a test to STRAINS


def snapshots(file: Path) -> pandas.DataFrame:
    """A row for each snapshot of a run: test, shape, seed, strain and the numbers of `of_snapshot`."""
    test, shape, seed, *engine = file.name.removesuffix(".run.nc").split("-")
    with lk.open_run(file) as run:
        strain = np.abs(run.lab.strain().values[run["record"].values]) * SHEARED[test]
        shares = run.lab.strength_shares().isel(time=run["record"].values)
        taken = [run.lab.snapshot(k) for k in range(run.lab.number_of_snapshots)]
        rows = [of_snapshot(one, lk.love_stress(taken[max(k, DIRECTION)])) for k, one in enumerate(taken)]
        balance = float(np.abs(run["energy_balance_error"]).max())
        inertial = float(run["inertial_number"].max())
    table = pandas.DataFrame(rows).assign(strain=np.round(strain, 2), energy_balance=balance, inertial_number=inertial)
    table = table.assign(**{f"share {name}": shares.sel(term=name).values for name in shares["term"].values})
    labels = {"test": test, "shape": shape, "seed": int(seed.removeprefix("s")), "engine": (engine or ["fused"])[0]}
    table, first = table.assign(**labels), [*labels, "strain"]
    return table[first + [name for name in table if name not in first]]


def of_snapshot(snapshot: lk.Snapshot, direction: np.ndarray) -> dict[str, float]:
    """Stress, errors of the forms, contributions of the error budget relative to q and p, and fabric of a snapshot.

    The q of an error is its component along the deviator of Love's stress; fabric is along the stress `direction`.
    """
    love = lk.love_stress(snapshot)
    p, q = float(lk.mean_stress(love)), float(equivalent_stress(love))
    found, arms = lk.statistics(snapshot), contact_arms(snapshot)
    errors = {form: stress - love for form, stress in forms_of(snapshot).items()}
    parts = errors | {f"budget {name}": part for name, part in error_budget(snapshot).items() if part.any()}
    tensors = {
        "A": found.contact_anisotropy,
        "branches": branch_anisotropy(snapshot),
        "axes": axis_anisotropy(snapshot),
        "G": np.asarray(found.contact_eccentricity),
        "F": found.normal_force_anisotropy,
        "Ft": found.mobilisation,
    }
    return {
        "p": p,
        "q/p": q / p,
        "e": float(lk.micro.void_ratio(snapshot)),
        "Z": found.coordination_number,
        **{name: float(along_deviator(tensor, direction)) for name, tensor in tensors.items()},
        **{f"{name} q": float(along_deviator(part, love)) / q for name, part in parts.items()},
        **{f"{name} p": float(lk.mean_stress(part)) / p for name, part in parts.items() if name not in CANCELLING},
        "contacts per pair": contacts_per_pair(snapshot),
        "negative l.n": float((arms < 0.0).mean()),
    }


def forms_of(snapshot: lk.Snapshot) -> dict[str, np.ndarray]:
    """The stress by each of FORMS and UNPLANNED, (3, 3), Pa."""
    found = lk.statistics(snapshot)
    G, M = found.contact_eccentricity, found.normal_force_eccentricity
    assert G is not None and M is not None
    length = np.linalg.norm(np.asarray(snapshot.contacts.vectors), axis=2)
    closed = normal_force_eccentricity(G, found.contact_anisotropy + found.normal_force_anisotropy)

    def c0(one: lk.micro.Statistics, eccentricity: np.ndarray | None) -> np.ndarray:
        tensors = one.contact_anisotropy, one.normal_force_anisotropy, one.mobilisation
        scalars = one.coordination_number, one.mean_normalised_force, void_ratio_nominal(snapshot)
        return c0_stress(snapshot.young_modulus, *scalars, *tensors, eccentricity)

    return {
        "printed": c0(lk.statistics(along_normals(snapshot, length)), None),
        "l.n": c0(found, None),
        "M": c0(found, M),
        "M - X": lk.sff_stress(snapshot, found),
        "G": c0(found, closed),
        "c0_volume": stress("c0_volume", snapshot),
        "fourth": stress("fourth", snapshot),
        "fourth, l.n": stress("fourth", along_normals(snapshot, contact_arms(snapshot))),
    }


def along_normals(snapshot: lk.Snapshot, length: np.ndarray) -> lk.Snapshot:
    """The snapshot with contact vectors of this length (n, 2), m, along the normals, for which M and X are zero."""
    contacts = snapshot.contacts
    vectors = length[:, :, None] * np.stack([contacts.normal, -contacts.normal], axis=1)
    return dataclasses.replace(snapshot, contacts=dataclasses.replace(contacts, vectors=vectors))

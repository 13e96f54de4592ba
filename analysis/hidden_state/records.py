"""What is kept of a test: the six state variables, stress, strain, and candidates for further ones."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

import labkit as lk
from labkit.micro import symmetric, to_six

AFTER_REVERSAL = (0, 1, 2, 3, 4, 6, 8, 12, 16)  # records since a reversal that are kept; then every few
EVERY, FEW = 8, 120  # largest interval between records that are kept, and their least number in a long test
MOST = 240  # records kept of a test
SLIDING = 0.99  # mobilisation from which a contact counts as sliding
NEW_DIRECTION = 3e-5  # norm of a strain increment whose direction counts
SIX = ("strain", "stress", "A", "F", "Ft", "strong", "young")
SCALARS = ("along", "e", "Z", "Lambda", "sliding", "mobilisation", "spread", "rolling", "variation", "new")


@dataclasses.dataclass(frozen=True)
class Records:
    """Records of a test.

    Args:
        columns: SIX (n, 6) in Mandel notation, SCALARS (n,), and `section`, the number of reversals so far, (n,).
            `strain` is the integral of the strain rate, compression positive; `along` that of its deviatoric norm.
        inertial: Largest inertial number while p is above 10 kPa.
        ended: Why the test ended before its target; empty otherwise.
    """

    columns: dict[str, np.ndarray]
    inertial: float
    ended: str

    def __len__(self) -> int:
        return len(self.columns["e"])

    def save(self, file: Path) -> None:
        """Write the file, whole or not at all."""
        temporary = file.with_suffix(".part.npz")
        further: dict[str, Any] = {"inertial": self.inertial, "ended": self.ended}
        np.savez_compressed(temporary, **self.columns | further)
        temporary.replace(file)

    @classmethod
    def load(cls, file: Path) -> Records:
        """Read a file."""
        with np.load(file) as stored:
            columns = {name: stored[name] for name in (*SIX, *SCALARS, "section")}
            return cls(columns, float(stored["inertial"]), str(stored["ended"]))


def strain_of_cells(cell: np.ndarray) -> np.ndarray:
    """The integral of the strain rate (n, 3, 3), compression positive, from cells (n, 3, 3) at short intervals."""
    increments = -symmetric(np.diff(cell, axis=0) @ np.linalg.inv(0.5 * (cell[1:] + cell[:-1])))
    return np.concatenate([np.zeros((1, 3, 3)), np.cumsum(increments, axis=0)])


def sections_of(strain: np.ndarray) -> np.ndarray:
    """Number of reversals before each record (n,): strain increments at more than 90 degrees to the last direction."""
    section, direction = np.zeros(len(strain), int), np.zeros(6)
    last = 0
    for k in range(1, len(strain)):
        step = strain[k] - strain[last]
        section[k] = section[k - 1]
        if np.linalg.norm(step) > NEW_DIRECTION:
            if step @ direction < 0.0:
                section[last + 1 : k + 1] += 1
            direction, last = step, k
    return section


def kept(section: np.ndarray) -> np.ndarray:
    """Indices of the records to keep."""
    starts = np.flatnonzero(np.diff(section, prepend=-1)) - 1
    since = np.arange(len(section)) - np.maximum(starts, 0)[section - section[0]]
    every = min(EVERY, max(1, len(section) // FEW))
    chosen = np.flatnonzero(np.isin(since, AFTER_REVERSAL) | (since % every == 0))
    chosen = np.union1d(chosen, [*np.maximum(starts, 0), len(section) - 1])
    return chosen if len(chosen) <= MOST else chosen[np.linspace(0, len(chosen) - 1, MOST).round().astype(int)]


def fabric(normal: np.ndarray) -> np.ndarray:
    """A of unit vectors (m, 3), in Mandel notation; zero without any."""
    return to_six(7.5 * (normal.T @ normal / len(normal) - np.eye(3) / 3.0)) if len(normal) else np.zeros(6)


def pairs_of(snapshot: lk.Snapshot) -> np.ndarray:
    """A number for the two grains of each contact, (m,)."""
    grain = np.sort(snapshot.contacts.grain.astype(np.int64), axis=1)
    return grain[:, 0] * snapshot.number_of_grains + grain[:, 1]


def candidates_of(snapshot: lk.Snapshot, scene: lk.Scene, since: np.ndarray) -> dict[str, np.ndarray | float]:
    """The candidates at one instant; `since` has the pairs in contact at the last reversal."""
    contacts = snapshot.contacts
    normal, force = contacts.normal, contacts.normal_force
    if len(force) == 0:
        return {"strong": np.zeros(6), "young": np.zeros(6)} | dict.fromkeys(SCALARS[4:], 0.0)
    pressing = np.maximum(force, 1e-30)
    mobilisation = np.linalg.norm(contacts.tangential_force, axis=1) / (scene.friction * pressing)
    mobilisation = np.minimum(mobilisation, 1.0)
    radii = snapshot.radius[contacts.grain]
    arm = np.prod(radii, axis=1) / np.sum(radii, axis=1)
    moment = np.linalg.norm(contacts.rolling_moment, axis=1) / (scene.rolling_friction * arm * pressing)
    new = ~np.isin(pairs_of(snapshot), since)
    return {
        "strong": fabric(normal[force > force.mean()]),
        "young": float(new.mean()) * fabric(normal[new]),
        "sliding": float((mobilisation > SLIDING).mean()),
        "mobilisation": float(mobilisation.mean()),
        "spread": float(mobilisation.std()),
        "rolling": float(np.minimum(moment, 1.0).mean()),
        "variation": float(force.std() / force.mean()),
        "new": float(new.mean()),
    }


def records_of(run: lk.Run, ended: str = "") -> Records:
    """The records of a run whose every record has a snapshot."""
    data = run.data
    data = data.isel(time=np.unique(data["record"].values.astype(int)))
    strain = to_six(strain_of_cells(data["cell"].values))
    section = sections_of(strain)
    chosen = kept(section)
    deviatoric = strain.copy()
    deviatoric[:, :3] -= strain[:, :3].mean(axis=1, keepdims=True)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(deviatoric, axis=0), axis=1))])
    found, since, number = [], pairs_of(run.snapshots[0]), 0
    for k in chosen:
        snapshot = run.snapshots[int(k)]
        found.append(candidates_of(snapshot, run.scene, since))
        if k + 1 < len(section) and section[k + 1] > number:
            since, number = pairs_of(snapshot), section[k + 1]
    names = {"stress": "stress", "A": "contact_anisotropy", "F": "normal_force_anisotropy", "Ft": "mobilisation"}
    columns = {key: to_six(symmetric(data[name].values[chosen])) for key, name in names.items()}
    columns |= {"strain": strain[chosen], "along": along[chosen], "section": section[chosen]}
    scalars = {"e": "void_ratio_nominal", "Z": "coordination_number", "Lambda": "mean_normalised_force"}
    columns |= {key: data[name].values[chosen] for key, name in scalars.items()}
    columns |= {key: np.array([row[key] for row in found]) for key in found[0]}
    carrying = lk.mean_stress(data["stress"].values) > 10e3
    inertial = float(np.max(data["inertial_number"].values[carrying], initial=0.0))
    single = {name: values.astype("f4" if values.dtype.kind == "f" else "i2") for name, values in columns.items()}
    return Records(single, inertial, ended or "")

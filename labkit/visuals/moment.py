"""Grains and contacts at one instant, of a state file or of a snapshot of a run file: what pictures show."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.runs.dataset import open_run, require_snapshots
from labkit.errors import InputError
from labkit.io.files import labkit_kind
from labkit.micro.contacts import Contacts, contacts_of
from labkit.micro.normalised import normalised_normal_force
from labkit.micro.stress import love_stress
from labkit.dem.scene import Scene
from labkit.dem.state import read_state


@dataclasses.dataclass(frozen=True)
class Moment:
    """position (grain, 3), m: wrapped into the cell, which begins at the origin; radius (grain,), m;
    cell (3, 3), m: cell vectors as columns; stress (3, 3), Pa: Love's; time, s; axial_strain since the start of the
    path, None for a state file; velocity (grain, 3), m/s, None for a run file; snapshot: its number in the file.
    """

    scene: Scene
    radius: np.ndarray
    position: np.ndarray
    cell: np.ndarray
    contacts: Contacts
    stress: np.ndarray
    time: float = 0.0
    axial_strain: float | None = None
    velocity: np.ndarray | None = None
    snapshot: int = 0

    @property
    def volume(self):
        """Volume of the cell, m3."""
        return float(np.linalg.det(self.cell))

    def contact_ends(self):
        """Both ends of each contact, (n, 2, 3), m: the first centre, in the cell, and from there along the branch to
        the second, which lies beyond the cell's face where the contact goes through it."""
        first = self.position[self.contacts.grain[:, 0]]
        branch = self.contacts.branch_length(self.radius)[:, None] * self.contacts.normal
        return np.stack([first, first + branch], axis=1)

    def normalised_force(self):
        """Lambda_n (Eq. 22) of each contact side, shape (n, 2)."""
        return normalised_normal_force(self.radius, self.contacts, self.scene.young_modulus)


def moments(file, snapshots=()):
    """The Moments of a file, one in memory at a time: that of a state file, the chosen or all of a run file.

    `snapshots`: numbers from 0, or from the end if negative. Raises InputError when the file has them not.
    """
    if labkit_kind(file) == "state":
        if snapshots:
            raise InputError(f"{file} is a state file, one moment: leave --snapshot out, or give a run file")
        return (of_state(read_state(file)) for _ in range(1))
    run = open_run(file)
    require_snapshots(run, file, snapshots, ", or a state file")
    number = run.sizes["snapshot"]
    return (of_snapshot(run, k % number) for k in snapshots or range(number))


def of_state(state):
    """The Moment of a State."""
    contacts = contacts_of(state)
    return Moment(
        state.scene, state.radius, wrapped(state.position, state.cell), state.cell, contacts,
        love_stress(contacts, state.radius, state.volume), state.time, velocity=state.velocity,
    )  # fmt: skip


def of_snapshot(run, snapshot):
    """The Moment of a snapshot of a run opened with labkit.open_run."""
    at = run.isel(time=int(run["record"].values[snapshot]))
    cell = at["cell"].values.astype(float)
    return Moment(
        run.lab.scene, run["radius"].values, wrapped(run["position"].values[snapshot], cell), cell,
        run.lab.contact_arrays(snapshot), at["stress"].values, float(at["time"]), float(at["axial_strain"]),
        snapshot=snapshot,
    )  # fmt: skip


def wrapped(position, cell):
    """Positions (n, 3) moved by cell periods into the cell (3, 3) at the origin."""
    return np.mod(np.linalg.solve(cell, position.T).T, 1.0) @ cell.T

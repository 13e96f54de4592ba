"""What a browser draws of a snapshot, as numbers: grains, forces and the cell. Needs NumPy alone."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np

from labkit.micro.cells import cell_corners
from labkit.micro.contact_sides import normalised_normal_force
from labkit.micro.grains import mean_per_grain, over_mean
from labkit.micro.snapshot import Snapshot, contacts_per_grain, love_stress
from labkit.micro.stress import equivalent_stress, mean_stress

EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
STICK = 0.08  # radius of the stick at mean force, in mean grain diameters
STEPS = 2**15 - 1  # positions are 16-bit fractions of the largest one


def view_from(azimuth: float, elevation: float) -> np.ndarray:
    """Return the view (3, 3) from an azimuth, degrees from x about z, and an elevation, degrees above the x-y plane."""
    a, b = np.radians([azimuth, elevation])
    toward = np.array([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(toward, right), toward])


VIEW = view_from(azimuth=30.0, elevation=20.0)


class Frames:
    """Snapshots of the same grains in the form that viewer.html reads.

    Args:
        snapshots: Snapshots that determine the scale, in which all of them fit.
        room: How many times farther from the centre the grains of later snapshots may be.
    """

    def __init__(self, snapshots: Sequence[Snapshot], room: float = 1.0) -> None:
        """Find the largest distance from the centre of the cell, m."""
        far = max(
            np.linalg.norm(_from_centre(snapshot, cell_corners(snapshot.cell)), axis=1).max() for snapshot in snapshots
        )
        self.far = far + 4.0 * max(
            snapshot.radius.max() for snapshot in snapshots
        )  # grains and contacts extend beyond the faces
        self.room, self.radius = room, snapshots[0].spheres.radius

    def common(self) -> dict[str, object]:
        """Return what all snapshots share."""
        return {
            "grains": len(self.radius),
            "radius": _text(self.radius / self.far, "<f4"),
            "extent": self.room,
            "width": STICK * 2.0 * self.radius.mean() / self.far,
            "view": VIEW.T.ravel().tolist(),
        }

    def frame(self, snapshot: Snapshot) -> dict[str, object]:
        """Return one snapshot, with positions as fractions of the largest distance from the centre of the cell."""
        said, of_grains, of_contacts = caption(snapshot), grain_ratio(snapshot), contact_ratio(snapshot)
        snapshot, far = snapshot.spheres, self.room * self.far
        ends = snapshot.contact_ends()
        edges, sides = cell_corners(snapshot.cell)[np.array(EDGES)], 1e3 * np.linalg.norm(snapshot.cell, axis=0)

        def fractions(points: np.ndarray) -> str:
            return _text(np.round(STEPS * np.clip(_from_centre(snapshot, points) / far, -1.0, 1.0)), "<i2")

        return {
            "caption": f"{said};  cell {' x '.join(f'{side:.3g}' for side in sides)} mm",
            "axes": (_from_centre(snapshot, np.vstack([np.zeros(3), snapshot.cell.T])) / self.far).round(4).tolist(),
            "position": fractions(snapshot.wrapped_position),
            "mean": _text(of_grains, "<f4"),
            "contacts": len(snapshot.contacts),
            "ends": fractions(ends),
            "ratio": _text(of_contacts, "<f4"),
            "edges": fractions(edges),
        }


def grain_ratio(snapshot: Snapshot) -> np.ndarray:
    """Return the mean Lambda_n of each grain over the mean of all contact sides, (sphere,); NaN without contacts.

    All spheres of a clump have the value of their clump.
    """
    normalised = normalised_normal_force(snapshot)
    ratio = over_mean(mean_per_grain(snapshot, normalised), np.abs(normalised))
    return snapshot.of_spheres(np.where(contacts_per_grain(snapshot) == 0, np.nan, ratio))


def contact_ratio(snapshot: Snapshot) -> np.ndarray:
    """Return Lambda_n of each contact over the mean of the magnitudes, (contact,)."""
    normalised = normalised_normal_force(snapshot)
    return over_mean(normalised.mean(axis=1), np.abs(normalised))


def caption(snapshot: Snapshot) -> str:
    """Describe a snapshot: axial strain, p, the invariant q, and the numbers of grains and contacts."""
    stress = love_stress(snapshot) / 1e3
    p, q = mean_stress(stress), equivalent_stress(stress)
    strain = "" if snapshot.axial_strain is None else f"axial strain {100 * snapshot.axial_strain:.1f} %,  "
    kind = "grains" if snapshot.clumps is None else "clumps"
    number = f"{len(snapshot.radius)} {kind}, {len(snapshot.contacts)} contacts"
    return f"{strain}p = {p:.0f} kPa,  q = {q:.0f} kPa;  {number}"


def _from_centre(snapshot: Snapshot, points: np.ndarray) -> np.ndarray:
    return points - snapshot.cell.sum(axis=1) / 2.0


def _text(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()

"""Void ratios: the nominal one, which C0 requires, and the one corrected for overlaps, which the paper reports."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from labkit.micro.snapshot import Snapshot


def lens_volume(radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> np.ndarray:
    """Return the volume (m3) of the lens common to two overlapping spheres; zero without overlap.

    The arguments, in m, may be arrays that broadcast.

    V = pi delta^2 (d^2 + 2 d (Ra + Rb) - 3 (Ra - Rb)^2)/(12 d) with the distance d = Ra + Rb - delta; if one sphere
    lies entirely inside the other, V is the volume of the inner sphere.
    """
    radius_a, radius_b, overlap = np.broadcast_arrays(radius_a, radius_b, overlap)
    smaller = np.minimum(radius_a, radius_b)
    inside = overlap >= 2.0 * smaller
    delta = np.where(inside, 0.0, np.maximum(overlap, 0.0))
    distance = radius_a + radius_b - delta
    lens = np.pi * delta**2 / (12.0 * distance)
    lens = lens * (distance**2 + 2.0 * distance * (radius_a + radius_b) - 3.0 * (radius_a - radius_b) ** 2)
    return np.where(inside, 4.0 / 3.0 * np.pi * smaller**3, lens)


def grain_volume(radius: np.ndarray) -> float:
    """Return the total grain volume V_g (m3), the sum of pi D^3/6 (below Eq. 16), from the radii (grain,), in m."""
    return 4.0 / 3.0 * np.pi * np.sum(np.asarray(radius) ** 3)


def void_ratio_nominal(snapshot: Snapshot) -> float:
    """Return the nominal void ratio e = V/V_g - 1 (above Eq. 17), which the derivation of C0 uses."""
    return snapshot.volume / snapshot.grain_volume - 1.0


def void_ratio(snapshot: Snapshot) -> float:
    """Return the void ratio that the paper reports: overlap lenses are subtracted from the solid volume (section 2).

    Each lens is subtracted separately, which is exact unless three grains overlap at the same point.
    """
    a, b = snapshot.spheres.radii
    lenses = lens_volume(a, b, snapshot.spheres.contacts.overlap).sum()
    return snapshot.volume / (snapshot.grain_volume - lenses) - 1.0

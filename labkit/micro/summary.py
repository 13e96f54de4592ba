"""The summary of a snapshot in notebooks: numbers of grains and contacts, density, stresses and cell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from labkit.micro.stress import deviatoric_stress, love_stress, mean_stress
from labkit.micro.void_ratio import void_ratio

if TYPE_CHECKING:
    from labkit.micro.snapshot import Snapshot


def summary(snapshot: Snapshot) -> dict[str, str]:
    """Return the summary of a snapshot, name -> value with its unit, as text."""
    grains, contacts = snapshot.number_of_grains, len(snapshot.contacts)
    stress = love_stress(snapshot) / 1e3
    sides = " x ".join(f"{1e3 * side:.3g}" for side in np.linalg.norm(snapshot.cell, axis=0))
    return {
        "grains": f"{grains:,}",
        "contacts": f"{contacts:,} (Z = {2 * contacts / grains:.2f})",
        "void ratio": f"{void_ratio(snapshot):.4f}",
        "mean stress": f"{mean_stress(stress):.4g} kPa",
        "q": f"{deviatoric_stress(stress):.4g} kPa",
        "cell": f"{sides} mm",
    }

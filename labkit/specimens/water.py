"""Skempton's pore pressure coefficient: how far a test at constant volume is from one with pore water."""

from __future__ import annotations

from labkit.micro.snapshot import Snapshot
from labkit.micro.void_ratio import void_ratio
from labkit.servo.correction import cell_stiffness

BULK_MODULUS = 2.2e9  # Pa, of water without air


def skempton_b(snapshot: Snapshot, bulk_modulus: float = BULK_MODULUS) -> float:
    """Return the least B = du/dp of the saturated specimen when the total mean stress p rises undrained.

        B = 1/(1 + n K/K_w)        n = e/(1 + e)

    K is the bulk modulus (Pa) of the skeleton if all grains moved with the mean field. The real one is smaller because
    contacts slip and grains rearrange, so B is at least this. Grains count as incompressible. As K_w grows, B tends to
    1, and an undrained test to one at constant volume.

    Args:
        snapshot: The specimen.
        bulk_modulus: Bulk modulus K_w of the pore water with the air in it, Pa.
    """
    skeleton, e = float(cell_stiffness(snapshot).sum()) / 9.0, void_ratio(snapshot)
    return 1.0 / (1.0 + e / (1.0 + e) * skeleton / bulk_modulus)

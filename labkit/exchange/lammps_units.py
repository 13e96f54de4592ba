"""Unit styles of LAMMPS that granular simulations use."""

from __future__ import annotations

STYLES = {  # name -> (length in m, force in N)
    "si": (1.0, 1.0),
    "cgs": (1e-2, 1e-5),
    "micro": (1e-6, 1e-9),
    "nano": (1e-9, 1e-12),
}


def units_of_style(style: str | None) -> tuple[float | None, float | None]:
    """Return (length in m, force in N) of a style, None if it is unknown or dimensionless (lj)."""
    return STYLES.get(style or "", (None, None))

"""Units that users may write, and their factors to SI units."""

from __future__ import annotations

UNITS: dict[str, dict[str, float]] = {  # SI unit -> accepted units and their factors
    "Pa": {
        **{"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9},
        **{"N/m2": 1.0, "kN/m2": 1e3, "MN/m2": 1e6, "N/mm2": 1e6, "N/cm2": 1e4},
        **{"bar": 1e5, "kgf/cm2": 98_066.5, "psi": 6_894.757293168361},
    },
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "1/s": {"1/s": 1.0},
    "kg/m3": {"kg/m3": 1.0, "g/cm3": 1e3, "t/m3": 1e3},
    "1": {"%": 0.01},
}
DECIMAL = (
    r"(?:\d++(?:\.\d*+)?+|\.\d++)"  # pattern of a number without sign and exponent, which never goes back in a text
)
SPELLINGS = str.maketrans({"\u00b2": "2", "\u00b3": "3", "^": None, "*": None, "\u00b5": "u", "\u03bc": "u"})


def plain_unit(text: str) -> str:
    """Return a unit as UNITS spells it: kN/m2 for kN/m^2, kN/m**2 or with a superscript, um for a micrometre."""
    return text.translate(SPELLINGS)

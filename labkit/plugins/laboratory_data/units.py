"""Units of laboratory tables: those of strains and of stresses, also as they appear in a header."""

from __future__ import annotations

import re

from labkit.errors import InputError, nearest

STRAIN_UNITS = {
    **dict.fromkeys(("1", "-", "m/m", "mm/mm", "decimal"), 1.0),
    **dict.fromkeys(("%", "percent", "pct"), 0.01),
    **dict.fromkeys(("\u2030", "permil"), 1e-3),
    **dict.fromkeys(("\u03bc\u03b5", "\u03bcstrain", "microstrain"), 1e-6),
}
STRESS_UNITS = {  # Pa
    **dict.fromkeys(("Pa", "N/m2"), 1.0),
    "hPa": 100.0,
    "mbar": 100.0,
    **dict.fromkeys(("kPa", "kN/m2"), 1e3),
    **dict.fromkeys(("MPa", "MN/m2", "N/mm2"), 1e6),
    "GPa": 1e9,
    "N/cm2": 1e4,
    "bar": 1e5,
    "atm": 101325.0,
    **dict.fromkeys(("kgf/cm2", "kg/cm2"), 98066.5),
    "t/m2": 9806.65,
    **dict.fromkeys(("psi", "lbf/in2"), 6894.757293168361),
    **dict.fromkeys(("psf", "lbf/ft2"), 47.88025898033584),
    "ksf": 47880.25898033584,
    "tsf": 95760.51796067168,
}
LENGTHS = ("m", "cm", "mm", "um", "in")
OTHERS = ("s", "min", "h", "N", "kN", "mm2", "mm3", "ml", "cm3", "\u00b0C", "g", "Hz")
BRACKETS = re.compile(r"[\[({]([^\[\](){}]*)[\])}]")


def _plain(unit: str) -> str:
    """Return a unit without brackets, blanks and raised letters: `[kN/m\u00b2]` becomes `kN/m2`."""
    text = unit.strip().strip("[](){}").replace("\u00b2", "2").replace("^2", "2").replace("**2", "2")
    return text.replace("\u00b5", "\u03bc").replace(" ", "")


def unit_factor(unit: str, units: dict[str, float]) -> float | None:
    """Return the factor of a unit in `units`, whatever the case of its letters; None if it is unknown."""
    plain, small = _plain(unit), {name.lower(): factor for name, factor in units.items()}
    return units.get(plain, small.get(plain.lower()))


def read_unit(quantity: str, unit: str, of_strain: bool) -> float:
    """Return the factor of a unit that the user gave. Raises InputError for an unknown unit."""
    units = STRAIN_UNITS if of_strain else STRESS_UNITS
    factor = unit_factor(unit, units)
    if factor is not None:
        return factor
    if of_strain:
        text = "1 or %" + ("; divide displacements by the initial height" if _plain(unit) in LENGTHS else "")
        raise InputError(f"the column {quantity} has the unit {unit}, which is not a unit of strain: give {text}")
    close = nearest(_plain(unit), units)
    names = "Pa, kPa, MPa, kN/m2, bar or psi" if close is None else f"{close!r}, or Pa, kPa, MPa, kN/m2, bar, psi"
    raise InputError(f"the column {quantity} has the unit {unit}, which is not a unit of stress: give {names}")


def is_unit(text: str) -> bool:
    """Return True if a cell is a unit of any kind that stands below a header."""
    return _is_strain_or_stress(text) or _plain(text) in (*LENGTHS, *OTHERS)


def unit_in_header(header: str) -> str | None:
    """Return the unit of a strain or stress that a header states, such as `sigma_1 [kPa]` or `q_kPa`; None if none.

    A number in brackets is an index, as in `stress(1)` or `c_s[1]`, except in `eps [1]`.
    """
    inside = [word for word in BRACKETS.findall(header)[::-1] if word.strip() != "1" or " [1]" in header]
    parts = [re.split(mark, header.strip()) for mark in (r"[\s_,;]+", "/")]
    after = [part[-1] for part in parts if len(part) > 1 and part[-1].strip("[](){}") not in ("1", "-", "")]
    words = (word.strip() for word in (*inside, *after))
    return next((word for word in words if word and _is_strain_or_stress(word)), None)


def _is_strain_or_stress(word: str) -> bool:
    return unit_factor(word, STRAIN_UNITS) is not None or unit_factor(word, STRESS_UNITS) is not None

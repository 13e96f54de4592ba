"""Values of a campaign file: numbers, numbers with units, words. Each reader takes a text and returns a value, or
raises ValueError with what to write instead."""

from __future__ import annotations

import math
import re

UNITS = {
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6},
    "length": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
    "rate": {"1/s": 1.0},
}
EXAMPLES = {"pressure": "0.5 MPa or 500 kPa", "length": "4 mm", "rate": "10 1/s"}


def number(text):
    """0.67, 1e-3."""
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{text!r} is no number: write e.g. 0.67, no unit") from None
    if not math.isfinite(value):
        raise ValueError(f"{text} is no number that can be used: write e.g. 0.67")
    return value


def whole(text):
    """20."""
    if not re.fullmatch(r"[+-]?\d{1,18}", text):
        raise ValueError(f"{text!r} is no whole number: write e.g. 20")
    return int(text)


def quantity(kind):
    """Reads a number with a unit of this kind, e.g. 0.5 MPa; the value is in SI."""

    def read(text):
        match = re.fullmatch(r"\s*([+-]?[0-9.]+(?:[eE][+-]?\d+)?)\s*(\S*)\s*", text)
        if not match:
            raise ValueError(f"{text!r} is no {kind}: write e.g. {EXAMPLES[kind]}")
        if not match[2]:
            raise ValueError(f"{text} has no unit: write e.g. {EXAMPLES[kind]}")
        if match[2] not in UNITS[kind]:
            raise ValueError(f"{match[2]!r} is no unit of a {kind}: use {', '.join(UNITS[kind])}")
        return number(match[1]) * UNITS[kind][match[2]]

    return read


def choice(options):
    """Reads one of some words."""

    def read(text):
        if text not in options:
            raise ValueError(f"{text!r} is unknown: use {', '.join(options)}")
        return text

    return read


def word(text):
    return text

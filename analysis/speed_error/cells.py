"""Numbers in the tables of the page."""

from __future__ import annotations

import numpy as np


def percent(value: float) -> str:
    """Formats a fraction as a percentage with its sign; `-` if it is not finite."""
    return "-" if not np.isfinite(value) else f"{short(100 * value, '+')} %"


def with_interval(value: float, within: float) -> str:
    """Formats an error or change with its 95 % half-width; in brackets if the interval includes zero."""
    if not np.isfinite(value):
        return "-"
    if not np.isfinite(within):
        return percent(value)
    text = f"{short(100 * value, '+')} ± {short(100 * within)} %"
    return f"({text})" if abs(value) <= within else text


def short(value: float, sign: str = "") -> str:
    """Formats a number with two digits and no exponent."""
    return f"{value:{sign}.0f}" if abs(value) >= 99.5 else f"{value:{sign}.2g}"

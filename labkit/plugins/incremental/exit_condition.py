"""Exit conditions of the Incremental Driver, such as `? s1 - s3 < -200`, as labkit's conditions on a record.

The left side is a sum of variables, each with an optional factor in front, and the right side is a number. Stresses are
in the unit of the test file, tension positive, except for p, q and P.
"""

from __future__ import annotations

import math
import re

from labkit.errors import InputError
from labkit.plugins.incremental.conventions import NAMES
from labkit.plugins.incremental.source import REAL, real_of, shorten, signed_terms

_PAIRS = ("1", "2", "3", "12", "13", "23")
_STATE = ("void_ratio_nominal", "coordination_number", "mean_normalised_force", *(f"A_{name}" for name in NAMES))
STRESSES = {
    **{f"s{pair}": f"-stress_{name}" for pair, name in zip(_PAIRS, NAMES, strict=True)},
    "p": "p",
    "q": "(stress_zz - stress_yy)",
    "P": f"{math.sqrt(3.0)!r}*p",
}
OTHERS = {
    **{f"e{pair}": f"-strain_{name}" for pair, name in zip(_PAIRS[:3], NAMES[:3], strict=True)},
    **{f"g{pair}": f"-2*strain_{name}" for pair, name in zip(_PAIRS[3:], NAMES[3:], strict=True)},
    "ev": "volumetric_strain",
    "eq": f"{2.0 / 3.0!r}*(strain_zz - strain_yy)",
    "eP": f"{1.0 / math.sqrt(3.0)!r}*volumetric_strain",
    "eQ": f"{math.sqrt(2.0 / 3.0)!r}*(strain_zz - strain_yy)",
    **{f"v{number}": name for number, name in enumerate(_STATE, start=1)},
}
_TERM = re.compile(rf"\s*+([+-]?)\s*+(?:({REAL.pattern})\s*+\*\s*+)?([A-Za-z]\w*)\s*")


def translate(text: str, unit: str) -> str:
    """Translate the text after the question mark to labkit's condition; `unit` is the file's unit of stress.

    Raises InputError, which does not name the line, if the text is not an exit condition.
    """
    parts = re.split(r"([<>])", text.strip())
    if len(parts) != 3:
        raise InputError(f"the exit condition {shorten(text.strip())} has no single < or >: write e.g. ? s1 < -200")
    left, sign, right = parts[0], parts[1], parts[2].strip()
    if not REAL.fullmatch(right):
        raise InputError(f"{shorten(right)} is not a number: the right side of an exit condition must be one")
    matches = signed_terms(_TERM, left, " in an exit condition: write e.g. s1 + 2*s3")
    terms = [_term(match[1] or "+", match[2], match[3], unit) for match in matches]
    if not terms:
        raise InputError("the exit condition has no variable on its left side: write e.g. ? s1 < -200")
    return f"{' '.join(terms)} {sign} {real_of(right)!r}"


def _term(sign: str, factor: str | None, name: str, unit: str) -> str:
    if name in STRESSES:
        value = f"{STRESSES[name]}/(1 {unit})"
    elif name in OTHERS:
        value = OTHERS[name]
    elif name == "Q":
        raise InputError("Q in an exit condition is q in the program and sqrt(2/3) q in its manual: write q instead")
    else:
        allowed = ", ".join([*STRESSES, *OTHERS])
        raise InputError(f"{shorten(name)} is not a variable of an exit condition: use {allowed}")
    return f"{sign} {real_of(factor or '1')!r}*({value})"

"""*ObeyRestrictions: six linear equations in the stress and strain increments of a step.

    mt . dT + me . d(eps) = m

Equations in stresses alone become held stresses. Equations in strains alone are solved for the strain rates: one
solution is prescribed, and the servo adds only strain rates that keep these equations satisfied.
"""

from __future__ import annotations

import re

import numpy as np

from labkit.errors import InputError
from labkit.plugins.incremental.source import REAL, Line, Source, shorten, signed_terms

_TERM = re.compile(rf"\s*+([+-]?)\s*+(?:({REAL.pattern})\s*+\*\s*+)?([se])d([1-6])\s*")
SINGULAR = 1e-9


def restrictions(source: Source) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read mt (6, 6), me (6, 6) and m (6,) from the next six lines, in the driver's components. Raises InputError."""
    mt, me, m = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    for row in range(6):
        line = source.data(f"restriction {row + 1} of 6")
        sides = line.text.split("=")
        if len(sides) != 2:
            raise line.error(f"{shorten(line.text)} is not a restriction: write e.g. sd1 + sd2 = 0")
        for factor, kind, number in _terms(line, sides[0]):
            matrix = mt if kind == "s" else me
            if matrix[row, number] != 0.0:
                raise line.error(f"{kind}d{number + 1} appears twice: write each component once")
            matrix[row, number] = factor
        m[row] = line.real(re.sub(r"^([+-])\s+", r"\1", sides[1].strip()).split(" ")[0])
        if mt[row].any() and me[row].any():
            problem = "a restriction on both stresses and strains is not supported: write it for one of them"
            raise line.error(problem)
        if not mt[row].any() and not me[row].any():
            raise line.error(f"{shorten(line.text)} restricts no stress or strain: name one, e.g. ed1 = 0")
    return mt, me, m


def _terms(line: Line, text: str) -> list[tuple[float, str, int]]:
    """Return (factor, s or e, number of the component from 0) for each term on the left side of an equation."""
    try:
        matches = signed_terms(_TERM, text, ": write a sum such as sd1 + 2.0*sd2 - sd3")
    except InputError as error:
        raise line.error(str(error)) from None
    return [
        ((-1.0 if sign == "-" else 1.0) * (line.real(factor) if factor else 1.0), kind, int(number) - 1)
        for sign, factor, kind, number in (match.groups() for match in matches)
    ]


def solve(me: np.ndarray, m: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Solve the equations in strains me (r, 6) . e = m (r,): a solution (6,), and a basis (6 - r, 6) for m = 0.

    Returns None if the equations contradict or repeat one another. Gauss-Jordan elimination keeps round numbers exact.
    """
    rows, pivots = np.column_stack([me, m]).astype(float), []
    for k in range(len(rows)):
        size = np.abs(rows[k:, :6]).max(initial=0.0)
        if size < SINGULAR:
            return None
        row, column = np.unravel_index(np.abs(rows[k:, :6]).argmax(), (len(rows) - k, 6))
        rows[[k, k + row]] = rows[[k + row, k]]
        rows[k] /= rows[k, column]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, column] * rows[k]
        pivots.append(int(column))
    solution, free = np.zeros(6), [column for column in range(6) if column not in pivots]
    solution[pivots] = rows[:, 6]
    basis = np.zeros((len(free), 6))
    for k, column in enumerate(free):
        basis[k, column] = 1.0
        basis[k, pivots] = -rows[:, column]
    return solution, basis

"""Conditions on the quantities of a record, such as `q/p > 0.9` or `r_u > 0.95 and p < 20 kPa`.

A condition consists of one or more comparisons (<, <=, >, >=) joined by `and` and `or`. Each side of a comparison is an
expression of names (labkit.quantities.scalars), numbers, which may carry a unit, + - * /, parentheses and abs(...).
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import math
import operator
import re
import warnings
from collections.abc import Callable, Collection

import numpy as np

from labkit.errors import InputError
from labkit.parameters import LARGE_STRAIN, SUSPECT_PRESSURE
from labkit.quantities.recorded import quantity
from labkit.quantities.scalars import Facts, Quantity, Record
from labkit.units import DECIMAL, UNITS, plain_unit

LONGEST = 300  # characters
EXAMPLE = "comparisons of quantities, e.g. q/p > 0.9 or abs(axial_strain) > 5 % and p < 20 kPa"
_UNITS = {name: (unit, factor) for unit in ("Pa", "m", "1") for name, factor in UNITS[unit].items()}
_SPELLED = [name.replace("2", r"(?:\^?2|\u00b2)") for name in sorted(_UNITS, key=len, reverse=True)]  # kN/m2, kN/m^2
_WITH_UNIT = re.compile(
    rf"(?<![\w.])({DECIMAL}(?:[eE][+-]?\d++)?+)\s*" + f"({'|'.join(_SPELLED)})" + r"(?=\s*(?:$|[-+*/<>=)]|and\b|or\b))"
)
_COMPARE: dict[type, Callable[[Number, Number], Number]] = {
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
}
_COMBINE: dict[type, Callable[[Number, Number], Number]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.divide,
}

Number = float | np.ndarray
Value = Callable[[Record, Facts], Number]


@dataclasses.dataclass(frozen=True)
class Side:
    """One side of a comparison: what the user wrote, and its value."""

    text: str
    part: _Part

    def shown(self, record: Record, facts: Facts) -> str:
        """Return the value at a record as text with its unit."""
        value, unit = float(self.part.value(record, facts)), self.part.unit
        factor, sign = (1e-3, " kPa") if unit == "Pa" else (100.0, " %") if self.part.strain else (1.0, "")
        return f"{factor * value:.4g}{sign}" + (f" {unit}" if unit in ("m", "degree", "J") else "")


@dataclasses.dataclass(frozen=True)
class Condition:
    """A condition on a record: `text` is what the user wrote, `quantities` are the rows of the table that it reads.

    `sides` are the sides of its comparisons that are not numbers.
    """

    text: str
    quantities: tuple[Quantity, ...]
    value: Value = dataclasses.field(compare=False)
    sides: tuple[Side, ...] = dataclasses.field(default=(), compare=False)

    def holds(self, record: Record, facts: Facts) -> bool:
        """Return True if the condition is met at a record of a run; a comparison with NaN is never met.

        Raises KeyError if a record lacks a variable.
        """
        with np.errstate(all="ignore"):
            return bool(self.value(record, facts))

    def reached(self, record: Record, facts: Facts) -> str:
        """Return the compared values at a record, e.g. `q/p = 0.52`. Raises KeyError if the record lacks a variable."""
        with np.errstate(all="ignore"):
            return ", ".join(f"{side.text} = {side.shown(record, facts)}" for side in self.sides)

    def require_meaning(self, facts: Facts) -> None:
        """Raise InputError if a quantity of the condition has no meaning for a run with these facts."""
        for each in self.quantities:
            each.require_meaning(facts)


def condition(text: str, field: str = "stop_when", recorded: Collection[str] | None = None) -> Condition:
    """Return the Condition that a text describes.

    Raises InputError if the text is not a condition, or if a quantity is unknown or not recorded.

    Args:
        text: Text of the condition.
        field: Name of the text in messages.
        recorded: Names of the variables in the records (default: the variables that a simulation records).
    """
    if len(text) > LONGEST:
        problem = f"is longer than {LONGEST} characters"
        raise InputError(problem, field=field, value=f"{text[:40]}...", allowed=EXAMPLE, quoted=True)
    try:
        parsed = _parse(text)
    except InputError as error:
        raise InputError(f"is not a condition: {error}", field=field, value=text, quoted=True) from None
    needs = {variable for each in parsed.quantities for variable in each.needs}
    missing = sorted(needs - set(recorded)) if recorded is not None else []
    if missing:
        problem = f"needs {', '.join(missing)}, which is not recorded here"
        raise InputError(problem, field=field, value=text, allowed="a condition on other quantities", quoted=True)
    return parsed


@functools.lru_cache(maxsize=256)
def _parse(text: str) -> Condition:
    numbers: list[_Part] = []

    def name_of(match: re.Match[str]) -> str:
        """Return the name that replaces a number with a unit."""
        unit, factor = _UNITS[plain_unit(match[2])]
        numbers.append(_number(float(match[1]) * factor, unit))
        return f"_{len(numbers) - 1} "

    if private := re.search(r"(?<![\w.])_\w*", text):  # such names stand for the numbers with a unit
        raise InputError(f"`{private[0]}` is neither a quantity nor a number")
    try:
        with warnings.catch_warnings(action="error"):  # of `5and`
            tree = ast.parse(_WITH_UNIT.sub(name_of, text).strip(), mode="eval").body
    except (SyntaxError, SyntaxWarning, DeprecationWarning, ValueError, RecursionError, MemoryError):
        raise InputError(f"give {EXAMPLE}") from None
    reader = _Reader(numbers)
    value = reader.logic(tree)
    return Condition(text, tuple(reader.quantities), value, tuple(reader.sides))


@dataclasses.dataclass(frozen=True)
class _Part:
    """Part of an expression: its value, its unit if known, and the number if the part is one without a unit.

    `strain` is True for a strain.
    """

    value: Value
    unit: str | None = None
    bare: float | None = None
    strain: bool = False


def _number(number: float, unit: str | None = None) -> _Part:
    return _Part(lambda record, facts: number, unit, number if unit is None else None)


class _Reader:
    """Converts a syntax tree to functions of (record, facts), and collects the quantities that they read."""

    def __init__(self, numbers: list[_Part]) -> None:
        self.numbers, self.quantities, self.sides = numbers, list[Quantity](), list[Side]()

    def logic(self, node: ast.expr) -> Value:
        if isinstance(node, ast.BoolOp):
            parts = [self.logic(value) for value in node.values]
            every = all if isinstance(node.op, ast.And) else any
            return lambda record, facts: every(part(record, facts) for part in parts)
        if not isinstance(node, ast.Compare) or len(node.ops) != 1 or type(node.ops[0]) not in _COMPARE:
            raise InputError(f"give {EXAMPLE}")
        compare = _COMPARE[type(node.ops[0])]
        before = len(self.quantities)
        left, of_left = self.part(node.left), len(self.quantities)
        right, of_right = self.part(node.comparators[0]), len(self.quantities)
        _require_same_unit(left, right)
        if of_right == before:
            raise InputError(f"no quantity is compared: give {EXAMPLE}")
        if ast.dump(node.left) == ast.dump(node.comparators[0]):
            raise InputError(f"`{ast.unparse(node.left)}` is compared with itself: give {EXAMPLE}")
        numbers = [part for part, varies in ((left, of_left > before), (right, of_right > of_left)) if not varies]
        with np.errstate(all="ignore"):
            if not all(np.isfinite(part.value({}, Facts())) for part in numbers):
                raise InputError("a number is too large: a comparison with it always, or never, holds")
        for side, part in ((node.left, left), (node.comparators[0], right)):
            text = ast.unparse(side).replace(" / ", "/")
            if re.search(r"\b[A-Za-z]", text) and not re.search(r"\b_\d", text):
                self.sides.append(Side(text, part))
        return lambda record, facts: compare(left.value(record, facts), right.value(record, facts))

    def part(self, node: ast.expr) -> _Part:
        if isinstance(node, ast.Name):
            return self.name(node.id)
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
            if math.isfinite(node.value):
                return _number(float(node.value))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            return self.with_sign(self.part(node.operand), -1.0 if isinstance(node.op, ast.USub) else 1.0)
        if isinstance(node, ast.BinOp) and type(node.op) in _COMBINE:
            return self.combine(node)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "abs":
            if len(node.args) == 1 and not node.keywords:
                inner = self.part(node.args[0])
                return _Part(lambda record, facts: np.abs(inner.value(record, facts)), inner.unit, strain=inner.strain)
        raise InputError(f"`{ast.unparse(node)}` is neither a quantity nor a number")

    def name(self, name: str) -> _Part:
        if name[0] == "_" and name[1:].isdecimal() and int(name[1:]) < len(self.numbers):
            return self.numbers[int(name[1:])]
        row = quantity(name)
        if row.every_record:
            raise InputError(f"{name} depends on all records, so a condition on one record cannot use it")
        self.quantities.append(row)
        return _Part(row, row.unit, strain="strain" in row.name or row.name.startswith("gamma"))

    def with_sign(self, inner: _Part, sign: float) -> _Part:
        if inner.bare is not None:
            return _number(sign * inner.bare)
        return _Part(lambda record, facts: sign * inner.value(record, facts), inner.unit, strain=inner.strain)

    def combine(self, node: ast.BinOp) -> _Part:
        combine, left, right = _COMBINE[type(node.op)], self.part(node.left), self.part(node.right)

        def value(record: Record, facts: Facts) -> Number:
            return combine(left.value(record, facts), right.value(record, facts))

        if isinstance(node.op, ast.Add | ast.Sub):
            _require_same_unit(left, right)
            return _Part(value, left.unit or right.unit, strain=left.strain or right.strain)
        return _Part(value, _product_unit(left, right, isinstance(node.op, ast.Div)))


def _product_unit(left: _Part, right: _Part, divided: bool) -> str | None:
    """Return the unit of a product or a quotient; None if it is unknown."""
    scalar = [part.bare is not None or part.unit == "1" for part in (left, right)]
    if scalar[1]:
        return left.unit
    if divided:
        return "1" if left.unit is not None and left.unit == right.unit else None
    return right.unit if scalar[0] else None


def _require_same_unit(left: _Part, right: _Part) -> None:
    """Raise InputError if a sum or comparison mixes units, or contains a number probably meant in kPa, MPa or %."""
    units = {left.unit, right.unit} - {None}
    if len(units) > 1:
        raise InputError(f"a quantity in {left.unit} cannot be compared with or added to one in {right.unit}")
    for part, other in ((left, right), (right, left)):
        if part.bare is not None and other.strain and abs(part.bare) > LARGE_STRAIN:
            raise InputError(f"{part.bare:g} has no unit: write {part.bare:g} % or {100.0 * part.bare:g} %")
        if part.bare is not None and other.unit == "Pa" and 0.0 < abs(part.bare) < SUSPECT_PRESSURE:
            raise InputError(
                f"{part.bare:g} has no unit, and is less than {SUSPECT_PRESSURE:g} Pa: write {part.bare:g} MPa or kPa, "
                f"or {part.bare:g} Pa if that is meant"
            )

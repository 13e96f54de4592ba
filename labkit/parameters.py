"""Parameters: each field of Scene, Recipe or a Path defines its unit, range and help text.

The Python argument, the command-line option and the campaign key are all derived from this definition. A value is a
number in SI units or text with a unit: `0.5e6`, `500 kPa`, `0.5 MPa`. The field that receives a text converts it; after
that a value is a number in SI units, which nothing converts or questions again.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import math
import numbers
import re
import sys
import traceback
import warnings
from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from labkit.errors import InputError, LabkitWarning, instead_of
from labkit.units import DECIMAL, UNITS, plain_unit

Given = TypeVar("Given")
Typed = TypeVar("Typed")
if TYPE_CHECKING:

    class Number(Generic[Given]):
        """Annotation of a field given as a number, or as text with a unit, and stored as a number in SI units."""

        def __get__(self, instance: object, owner: type, /) -> Given: ...
        def __set__(self, instance: object, value: Given | str, /) -> None: ...

    class Numbers:
        """Annotation of a field given as several numbers, or as text, and stored as a tuple in SI units."""

        def __get__(self, instance: object, owner: type, /) -> tuple[float, ...]: ...
        def __set__(self, instance: object, value: Iterable[float | str], /) -> None: ...
else:

    class Number:
        """At run time, `Number[T]` is T itself."""

        def __class_getitem__(cls, kind: type) -> type:
            return kind

    Numbers = tuple[float, ...]

EXAMPLES = {"Pa": "0.5 MPa or 500 kPa", "m": "4 mm", "1/s": "10 1/s", "kg/m3": "2650 kg/m3", "1": "0.67"}
MOST_NUMBER: Any = sys.float_info.max
SUSPECT_PRESSURE = 1000.0  # Pa: a smaller number without a unit was probably meant in MPa or kPa
LIKELY = {  # unit -> range of numbers that need no unit, and the units probably meant outside this range
    "Pa": (SUSPECT_PRESSURE, math.inf, "MPa or kPa"),
    "modulus": (1e6, math.inf, "GPa or MPa"),
    "m": (0.0, 0.1, "mm"),
    "kg/m3": (100.0, math.inf, "g/cm3"),
}
LARGE_STRAIN = 1.0  # a larger number without a unit was probably meant in %
STRAINS = ("reversals", "over")  # parameters that are strains, apart from those with a name such as strain_limit
DECIMAL_COMMA = re.compile(r"\s*+[+-]?\d*+,\d++(?:[eE][+-]?\d++)?+\s*+(?:[^\s\d,]\S*+)?+\s*+")
NUMBER = re.compile(rf"\s*+([+-]?{DECIMAL}(?:[eE][+-]?\d++)?+)\s*+((?:.*\S)?+)\s*+")


@dataclasses.dataclass(frozen=True)
class Parameter:
    """Definition of a parameter.

    `low` and `high` bound the range, `above` is an excluded lower bound, and `choices` are the allowed text values. The
    `kind` is float, int, bool, str, tuple for a list of numbers, or a dataclass for a list of its instances; this list
    may be given as JSON. `optional` allows None. `option` turns the parameter into a command-line option and a campaign
    key. `is_strain` marks a strain whose name does not say it.
    """

    name: str
    default: Any = None
    help: str = ""
    unit: str = "1"
    kind: type = float
    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    choices: Collection[str] | None = None
    optional: bool = False
    option: bool = False
    is_strain: bool = False

    @property
    def strain(self) -> bool:
        """True if the value is a strain, or several."""
        named = ("strain" in self.name or self.name in STRAINS) and "rate" not in self.name
        return self.unit == "1" and (self.is_strain or named)

    @property
    def example(self) -> str:
        """An example value, as a user might type it."""
        return EXAMPLES.get(self.unit, f"1 {self.unit}")

    @property
    def allowed_values(self) -> str:
        """The allowed values in words, for an error message."""
        if self.choices is not None:
            return instead_of(self.choices)
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.kind is bool:
            return "true or false"
        if self.kind is str:
            return "text"
        if self.kind is tuple:
            return "numbers separated by commas"
        if dataclasses.is_dataclass(self.kind):
            return f"a list of {self.kind.__name__}"
        number = "a whole number" if self.kind is int else "a number"
        if math.isfinite(self.above):
            most = f", at most {self.high:g}" if math.isfinite(self.high) else ""
            return f"{number} above {self.above:g}{most}{unit}"
        if math.isfinite(self.low) and -1e-6 < self.high < 0.0:
            return f"a negative number from {self.low:g}{unit}"
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{self.low:g} to {self.high:g}{unit}"
        return f"{number}, e.g. {self.example}"

    def error(
        self, value: object, problem: str = "is not valid", allowed: str | None = None, quoted: bool = False
    ) -> InputError:
        """Return the InputError for an invalid value of this parameter."""
        return InputError(problem, field=self.name, value=value, allowed=allowed or self.allowed_values, quoted=quoted)

    def read(self, value: object) -> Any:
        """Check a value, a number in SI units or text, and return it in SI units. Raises InputError."""
        if value is None and self.optional:
            return None
        if self.kind is bool:
            return self._flag(value)
        if self.choices is not None or self.kind is str:
            return self._choice(value)
        if self.kind is tuple:
            return tuple(self._number(part) for part in self._parts(value) if part != "")
        if dataclasses.is_dataclass(self.kind):
            return tuple(self._instance(element) for element in self._objects(value))
        return self.check(self._number(value))

    def _parts(self, value: object) -> Iterable[object]:
        if isinstance(value, str):
            return value.strip("()[] ").split(",")
        if not isinstance(value, Iterable):
            raise self.error(value, "is not a list of numbers")
        return value

    def _objects(self, value: Any) -> Iterable[object]:
        if isinstance(value, str):
            try:
                value = json.loads(value)
            except (ValueError, RecursionError):
                raise self.error(value[:40], "is not JSON", "a list in JSON", quoted=True) from None
        if not isinstance(value, list | tuple):
            raise InputError("is not a list", field=self.name, allowed=f"a list of {self.kind.__name__}")
        return value

    def _instance(self, value: Any) -> object:
        if isinstance(value, self.kind):
            return value
        try:
            return self.kind(**value)
        except (TypeError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"is not a list of {self.kind.__name__}: {error}", field=self.name) from None

    def _flag(self, value: object) -> bool:
        if isinstance(value, str):
            value = {"true": True, "false": False}.get(value.lower(), value)
        if not isinstance(value, bool):
            raise self.error(value, allowed="True or False")
        return value

    def _choice(self, value: object) -> str:
        if not isinstance(value, str) or (self.choices is not None and value not in self.choices):
            raise self.error(value, "is unknown", instead_of(self.choices or (), value), quoted=True)
        return value

    def _number(self, value: Any) -> float:
        if isinstance(value, str):
            value = self._text(value)
        elif isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise self.error(value, "is not a number")
        elif isinstance(value, numbers.Rational) and abs(value) > MOST_NUMBER:
            raise self.error(None, "is too large")  # the number may be too long to print
        if self.kind is int:
            if value != value or abs(value) > 1e18 or int(value) != value:
                raise self.error(value, "is not a whole number")
            return int(value)
        return float(value)

    def _text(self, text: str) -> float:
        match = NUMBER.fullmatch(text)
        if DECIMAL_COMMA.fullmatch(text):
            right = text.strip().replace(",", ".")
            share = "strain" in self.name and self.unit == "1" and NUMBER.fullmatch(right)
            percent = f" or {100.0 * float(right):g} %" if share and not share[2] else ""
            whole = f" or {text.strip().replace(',', '')}" * bool(re.search(r"[1-9]\d*,\d{3}(?!\d)", text))
            raise self.error(text, "has a decimal comma", f"{right}{percent}{whole}", quoted=True)
        if not match or text.strip()[:2] in ("0x", "0o", "0b") or (self.kind is int and match[2]):
            if text.strip().lower().lstrip("+-") in ("nan", "inf", "infinity"):
                raise self.error(text, "is not valid")
            example = "20" if self.kind is int else self.example
            raise self.error(text, "is not a number", f"e.g. {example}", quoted=True)
        value, unit = float(match[1]), match[2]
        units = UNITS.get(self.unit, {self.unit: 1.0})  # a user-defined path may use any unit
        if unit and (unit := unit if unit in units else plain_unit(unit)) not in units:
            if re.match(r"1(?!/)|[02-9_]|[^\w%\u00b0]", unit):
                raise self.error(text, "is not a number", f"e.g. {self.example}", quoted=True)
            same = [name for name in units if unit.lower() == name.lower() and (unit.islower() or unit.isupper())]
            allowed = f"{match[1]} {same[0]}" if same else f"it in {', '.join(units)}"
            raise self.error(text, f"has an unknown unit {match[2]!r}", allowed)
        return value * units[unit] if unit else value

    def require_unit(self, text: Typed) -> Typed:
        """Return the text, or texts, that a user typed. Raises InputError for a number hardly meant in SI units."""
        doubt = self.doubt(text)
        if doubt is not None:
            raise doubt
        return text

    def doubt(self, value: object) -> InputError | None:
        """Return what to ask about a number or text without a unit that was probably not meant in the SI unit."""
        if self.kind not in (float, int, tuple) or value is None:
            return None
        parts = self._parts(value) if self.kind is tuple else [value]
        return next((doubt for part in parts if (doubt := self._doubt(part)) is not None), None)

    def _doubt(self, value: object) -> InputError | None:
        match = NUMBER.fullmatch(str(value))
        if not match or match[2]:
            return None
        number = float(match[1])
        typed_1 = str(value).strip().lstrip("+-") == "1" and isinstance(value, str)
        if self.strain and (abs(number) > LARGE_STRAIN or typed_1):
            possible = self.low <= number <= self.high
            return self.error(number, "has no unit", f"{number:g} %{f' or {100.0 * number:g} %' * possible}")
        kind = "modulus" if "modulus" in self.name else self.unit
        if number <= 0.0 or kind not in LIKELY or (kind == "Pa" and self.low > 0.0):
            return None
        low, high, meant = LIKELY[kind]
        if low <= number <= high:
            return None
        problem = f"has no unit, and is {f'less than {low:g}' if number < low else f'more than {high:g}'} {self.unit}"
        return self.error(number, problem, f"{number:g} {meant}, or {number:g} {self.unit} if that is meant")

    def check(self, value: float) -> float:
        """Return the value. Raises InputError if it is outside the range."""
        if not (math.isfinite(value) and self.low <= value <= self.high and value > self.above):
            share = "strain" in self.name and self.unit == "1" and 1.0 < abs(value) <= 100.0
            raise self.error(value, allowed=f"{self.allowed_values}{f', or {value:g} % if that is meant' * share}")
        return value


def parameter(
    default: object = dataclasses.MISSING,
    *,
    help: str,
    unit: str = "1",
    low: float = -math.inf,
    high: float = math.inf,
    above: float = -math.inf,
    choices: Collection[str] | None = None,
    kind: type | None = None,
) -> Field:
    """Return a dataclass field that is a Parameter, by default of the type of `default`."""
    kind = kind or (float if default in (dataclasses.MISSING, None) else type(default))
    definition = Parameter("", default, help, unit, kind, low, high, above, choices, default is None, True)
    return dataclasses.field(default=default, metadata={"parameter": definition})


def without_option(field: Field) -> Field:
    """Return the field of a parameter, changed to have no command-line option and no campaign key."""
    definition = dataclasses.replace(field.metadata["parameter"], option=False)
    return dataclasses.field(default=field.default, metadata={"parameter": definition})


Field: TypeAlias = Any  # a dataclasses.Field that stands for a value of any type
Keys = dict[str, Parameter]  # parameters by name
Values = dict[str, Any]  # name -> number in SI units, or text that a user typed


@functools.cache
def parameters_of(kind: type) -> Mapping[str, Parameter]:
    """Return the parameters of a dataclass, name -> Parameter; its other fields are left out."""
    return {field.name: named(field.name, field) for field in dataclasses.fields(kind) if "parameter" in field.metadata}


def named(name: str, field: Field) -> Parameter:
    """Return the Parameter of a field under its name."""
    definition: Parameter = field.metadata["parameter"]
    return dataclasses.replace(definition, name=name)


def options_of(kind: type) -> Keys:
    """Return the parameters of a dataclass that a user may set; `further_parameters` of the class are among them."""
    further: Mapping[str, Parameter] = kind.further_parameters() if hasattr(kind, "further_parameters") else {}
    return {name: definition for name, definition in {**further, **parameters_of(kind)}.items() if definition.option}


def check_parameters(value: object) -> None:
    """Convert and check all parameters of a dataclass instance in place, in its __post_init__. Raises InputError.

    Warns of a number without a unit that was probably not meant in the SI unit if a user's line creates the instance.
    """
    kind: type = type(value)
    for name, definition in parameters_of(kind).items():
        argument = getattr(value, name)
        number = definition.read(argument)
        object.__setattr__(value, name, number)
        if number != definition.default:
            warn_of_doubt(definition.doubt(argument), value)


def warn_of_doubt(doubt: InputError | None, created: object = None, depth: int = 2) -> None:
    """Warn of a value that is probably not meant in the SI unit, at the line of the user who passed it.

    Nothing is said about the values of labkit itself and of dataclasses.replace, which are in SI units.

    Args:
        doubt: What to ask, if anything (Parameter.doubt).
        created: The object whose constructor received the value.
        depth: Otherwise, the number of calls between the user's line and this function.
    """
    if doubt is None:
        return
    frames = [frame for frame, _ in traceback.walk_stack(inspect.currentframe())]
    if created is not None:
        inits = (n for n, frame in enumerate(frames) if frame.f_code.co_name == "__init__")
        depth = max(n for n in inits if frames[n].f_locals.get("self") is created) + 1
    frame = frames[depth]
    module = str(frame.f_globals.get("__name__"))
    if module.partition(".")[0] not in ("labkit", "dataclasses", "copy"):
        place = frame.f_code.co_filename, frame.f_lineno, module
        registry = frame.f_globals.setdefault("__warningregistry__", {})
        warnings.warn_explicit(str(doubt), LabkitWarning, *place, registry)

"""Gradings: distributions of grain diameters by number or by mass, given as text.

    uniform smallest=0.1mm largest=0.4mm by=mass
    lognormal median=0.2mm sigma=0.3 smallest=0.1mm largest=0.5mm
    rosin_rammler scale=0.25mm exponent=4 smallest=0.1mm largest=0.5mm
    sieve diameters=0.1mm,0.2mm,0.4mm passing=0%,45%,100%
    curve.csv

All distributions are cut at the smallest and the largest diameter. `by` says whether the distribution is by number or
by mass (the default, except for `uniform`). A CSV file has two columns with the headings `diameter_mm` (or _um, _m) and
`passing_percent` (or passing_fraction), and is read as a `sieve` by mass.

The distributions of the same grading by mass, dM, and by number, dN, obey dM ~ D^3 dN. Grains are drawn by number, one
from each of N intervals of equal probability, so a few hundred grains already follow the curve. The cell should
nevertheless be ten of the largest grains wide (labkit.records.limits). All diameters are finally multiplied by a factor
close to 1 that makes the volume exact.
"""

from __future__ import annotations

import abc
import dataclasses
import functools
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from labkit.errors import InputError
from labkit.parameters import LIKELY, Number, Numbers, Values, check_parameters, parameter, parameters_of
from labkit.text.reading import read_table, text_of
from labkit.units import UNITS

MOST_RATIO = 10.0  # largest ratio of the largest to the smallest diameter
LONGEST = 200  # largest number of characters of a heading
POINTS = 2001  # number of points in the tabulated distributions
SCALING = 0.03  # largest relative change of the drawn diameters that makes their volume exact
MEASURES = ("number", "mass")
# The path of a CSV file, which may contain blanks, and parameters.
TABLE = re.compile(r"\s*(.+\.(?:csv|txt|tsv|dat))((?:\s+\w+=\S*)*)\s*", re.IGNORECASE)
# Column headings of a sieve curve, with their units.
DIAMETER = re.compile(r"(?:diameter|sieve|size|opening|aperture).*?[\s_(\[,/](um|mm|cm|m)\b")
PASSING = re.compile(r"(?:passing|finer).*?[\s_(\[,/](percent|%|fraction|1|-)")


@dataclasses.dataclass(frozen=True, eq=False)
class Table:
    """Cumulative distributions (0 to 1) by number and by mass at ascending diameters (m), as arrays (n,)."""

    diameter: np.ndarray
    by_number: np.ndarray
    by_mass: np.ndarray


@dataclasses.dataclass(frozen=True)
class Grading(abc.ABC):
    """A distribution of diameters (m) between `smallest` and `largest`, by number or by mass.

    Raises InputError for values outside their ranges or a size ratio above 10.
    """

    smallest: Number[float] = parameter(unit="m", above=0.0, high=1e3, help="smallest diameter")
    largest: Number[float] = parameter(unit="m", above=0.0, high=1e3, help="largest diameter")
    by: str = parameter("mass", choices=MEASURES, help="what the distribution counts")

    name: ClassVar[str]

    def __post_init__(self) -> None:
        """Check every value."""
        check_parameters(self)
        self._check_range()

    def _check_range(self) -> None:
        ratio = self.largest / self.smallest
        if not 1.0 < ratio <= MOST_RATIO * (1.0 + 1e-12):
            allowed = f"more than smallest, {self.smallest:g} m, and at most {MOST_RATIO:g} times that"
            raise InputError(field="largest", value=self.largest, allowed=allowed)

    @abc.abstractmethod
    def distribution(self, diameter: np.ndarray) -> np.ndarray:
        """Return the cumulative distribution at diameters (m) of any shape, before it is cut at both ends."""

    @functools.cached_property
    def table(self) -> Table:
        """Tabulate the distributions by number and by mass after cutting."""
        diameter = np.union1d(np.geomspace(self.smallest, self.largest, POINTS), self._corners())
        passing = self.distribution(diameter)
        share = np.diff(passing) / (passing[-1] - passing[0])
        a, b = diameter[:-1], diameter[1:]
        if self.by == "mass":  # the mean of 1/D^3, or of D^3, over an interval
            other = share * (a**-2 - b**-2) / (2.0 * (b - a))
        else:
            other = share * (b**4 - a**4) / (4.0 * (b - a))
        sums = [np.concatenate([[0.0], np.cumsum(values / values.sum())]) for values in (share, other)]
        number, mass = sums if self.by == "number" else sums[::-1]
        return Table(diameter, number, mass)

    def _corners(self) -> np.ndarray:
        """Return the diameters (m) at which the slope of the distribution jumps."""
        return np.array([self.smallest, self.largest])

    @functools.cached_property
    def mean_diameter(self) -> float:
        """Mean diameter by number (m)."""
        return self._mean(1)

    @functools.cached_property
    def mean_volume(self) -> float:
        """Mean of pi D^3/6 by number (m3)."""
        return math.pi / 6.0 * self._mean(3)

    def _mean(self, power: int) -> float:
        """Return the mean of D^power by number, with a constant probability density in each interval of the table."""
        a, b = self.table.diameter[:-1], self.table.diameter[1:]
        moments = (b ** (power + 1) - a ** (power + 1)) / ((power + 1) * (b - a))
        return float(np.diff(self.table.by_number) @ moments)

    def percentile(self, share: float, by: str = "mass") -> float:
        """Return the diameter (m) that the fraction `share` of the mass, or of the number, passes: D50 for 0.5."""
        table = self.table
        return float(np.interp(share, table.by_mass if by == "mass" else table.by_number, table.diameter))

    def draw(self, solid_volume: float, rng: np.random.Generator) -> np.ndarray:
        """Sample grain radii (m) whose total volume is `solid_volume` (m3), in ascending order, shape (grain,).

        Raises InputError if so few grains cannot represent the grading.
        """
        count = max(1, round(solid_volume / self.mean_volume))
        share = (np.arange(count) + rng.random(count)) / count
        radius = 0.5 * np.interp(share, self.table.by_number, self.table.diameter)
        factor = float((solid_volume / (4.0 / 3.0 * math.pi * np.sum(radius**3))) ** (1.0 / 3.0))
        if abs(factor - 1.0) > SCALING:
            reason = f"needs more than {count} grains: their diameters would have to change by {factor - 1.0:.0%}"
            raise InputError(reason, field="grading", value=self.name, allowed="more grains or a narrower grading")
        return radius * factor

    def to_text(self) -> str:
        """Return the text that `read_grading` accepts, in SI units."""
        values = {name: (getattr(self, name), parameter.unit) for name, parameter in parameters_of(type(self)).items()}
        return " ".join([self.name, *(f"{name}={_text(*value)}" for name, value in values.items())])


def _text(value: object, unit: str) -> str:
    if isinstance(value, tuple):
        return ",".join(_text(part, unit) for part in value)
    return f"{value}m" if unit == "m" and isinstance(value, float) and value > LIKELY[unit][1] else f"{value}"


@dataclasses.dataclass(frozen=True)
class Uniform(Grading):
    """A uniform probability density of diameters between the smallest and the largest."""

    by: str = parameter("number", choices=MEASURES, help="what the distribution counts")

    name = "uniform"

    def distribution(self, diameter: np.ndarray) -> np.ndarray:
        return diameter / self.largest


@dataclasses.dataclass(frozen=True)
class Lognormal(Grading):
    """Normal distribution of ln D with the mean ln(median) and the standard deviation sigma."""

    median: Number[float] = parameter(0.17e-3, unit="m", above=0.0, high=1e3, help="median diameter, before cutting")
    sigma: Number[float] = parameter(0.3, above=0.0, high=5.0, help="standard deviation of ln D")

    name = "lognormal"

    def distribution(self, diameter: np.ndarray) -> np.ndarray:
        scaled = np.log(diameter / self.median) / (self.sigma * math.sqrt(2.0))
        return 0.5 * (1.0 + np.vectorize(math.erf, otypes=[float])(scaled))


@dataclasses.dataclass(frozen=True)
class RosinRammler(Grading):
    """Rosin-Rammler distribution: the fraction passing D is 1 - exp(-(D/scale)^exponent)."""

    scale: Number[float] = parameter(
        0.17e-3, unit="m", above=0.0, high=1e3, help="diameter that 63.2 % passes, before cutting"
    )
    exponent: Number[float] = parameter(
        4.0, above=0.0, high=50.0, help="exponent; a larger one makes the grading narrower"
    )

    name = "rosin_rammler"

    def distribution(self, diameter: np.ndarray) -> np.ndarray:
        return -np.expm1(-((diameter / self.scale) ** self.exponent))


@dataclasses.dataclass(frozen=True)
class Sieve(Grading):
    """A sieve curve, linear in ln D between the points (diameters, m; passing, 0 to 1)."""

    smallest: float = dataclasses.field(init=False, default=math.nan)
    largest: float = dataclasses.field(init=False, default=math.nan)
    diameters: Numbers = parameter((), unit="m", help="diameters of the points, ascending")
    passing: Numbers = parameter((), help="share that passes each diameter, from 0 to 1")

    name = "sieve"

    def __post_init__(self) -> None:
        check_parameters(self)
        D, passing = np.array(self.diameters), np.array(self.passing)
        if (D == 0.0).any():
            allowed = "the size of the smallest grains instead, or leave it out if nothing passes the sieve above it"
            raise InputError("has a size of 0 (the pan)", field="diameters", allowed=allowed)
        if len(D) < 2 or not (D > 0.0).all() or not (np.diff(D) > 0.0).all():
            raise InputError(field="diameters", value=self.diameters, allowed="two or more ascending diameters")
        if len(passing) != len(D) or passing[0] != 0.0 or passing[-1] != 1.0 or not (np.diff(passing) >= 0.0).all():
            allowed = "one ascending value for each diameter, the first 0 and the last 1 or 100%"
            raise InputError(field="passing", value=self.passing, allowed=allowed)
        object.__setattr__(self, "smallest", float(D[0]))
        object.__setattr__(self, "largest", float(D[-1]))
        self._check_range()

    def distribution(self, diameter: np.ndarray) -> np.ndarray:
        return np.interp(np.log(diameter), np.log(self.diameters), self.passing)

    def _corners(self) -> np.ndarray:
        return np.array(self.diameters)


def sizes_of(radius: np.ndarray) -> dict[str, float]:
    """Return the mean_diameter (m) and diameter_spread of a scene for grains with these radii (m), (n,).

    The spread is chosen so that a uniform distribution has the same standard deviation. It is smaller if the largest
    diameter would otherwise exceed MOST_RATIO times the smallest.
    """
    widest = (MOST_RATIO - 1.0) / (MOST_RATIO + 1.0)
    spread = min(float(np.sqrt(3.0) * radius.std() / radius.mean()), 0.999 * widest)
    return {"mean_diameter": 2.0 * float(radius.mean()), "diameter_spread": spread}


GRADINGS: dict[str, type[Grading]] = {kind.name: kind for kind in (Uniform, Lognormal, RosinRammler, Sieve)}


FILE = re.compile(r"\s*(.+\.(?:csv|txt|tsv|dat))((?:\s+\w+=\S*)*)\s*", re.IGNORECASE)  # a path may contain blanks


def read_grading(text: str) -> Grading:
    """Return the Grading that a text or a CSV file describes (formats: see the module). Raises InputError."""
    if not text.strip():
        raise InputError("is empty", field="grading", allowed=f"one of {', '.join(GRADINGS)}, or a CSV file")
    table = FILE.fullmatch(text)
    return _of_text(text) if table is None else _read(text, table)  # a file may change: it is read again


def _read(text: str, table: re.Match[str] | None = None) -> Grading:
    values: Values = _read_table(Path(table[1])) if table else {}
    described = f"{Sieve.name}{table[2]}" if table else text
    name, *words = re.sub(r"(?<=\d)\s+(?=%|[a-z]*m\b)", "", described).split()  # `0.1 mm` is read as `0.1mm`
    if name not in GRADINGS:
        allowed = f"one of {', '.join(GRADINGS)} with its values, or a CSV file"
        raise InputError("is unknown", field="grading", value=name, allowed=allowed, quoted=True)
    parameters = parameters_of(GRADINGS[name])
    for word in words:
        key, equals, value = word.partition("=")
        if key not in parameters or not equals:
            allowed = f"{name} with {', '.join(f'{name}=...' for name in parameters)}"
            raise InputError(
                "is not a value of this grading", field="grading", value=word, allowed=allowed, quoted=True
            )
        values[key] = parameters[key].require_unit(value)
    missing = [
        name
        for name, parameter in parameters.items()
        if parameter.default is dataclasses.MISSING and name not in values
    ]
    if missing:
        raise InputError("is not complete", field="grading", value=text, allowed=f"{missing[0]}=... too", quoted=True)
    try:
        return GRADINGS[name](**values)
    except InputError as error:
        if table is None:
            raise
        raise InputError(f"is not a sieve curve ({error})", field="grading", value=table[1]) from None


_of_text = functools.lru_cache(_read)


def _read_table(file: Path) -> dict[str, object]:
    """Read a sieve curve from a table: diameters in ascending order, and the fraction passing each of them."""
    allowed = "two columns with the headings diameter_mm (or _um, _m) and passing_percent (or passing_fraction)"
    try:
        table = read_table(text_of(file, "give a CSV file"), file)
        headings = [name[:LONGEST].replace("\u00b5", "u").replace("\u03bc", "u").lower() for name in table.names or ()]
        (D, unit), (passing, share) = (_column(headings, pattern) for pattern in (DIAMETER, PASSING))
        factors = UNITS["m"][unit], 1.0 if share in ("fraction", "1", "-") else 0.01
        points = np.unique(table.numbers(file)[:, [D, passing]] * factors, axis=0)
        if np.isnan(points).any():
            raise ValueError
    except InputError as error:
        raise InputError(str(error), field="grading", value=str(file), allowed=allowed) from None
    except ValueError:
        raise InputError("is not a sieve curve", field="grading", value=str(file), allowed=allowed) from None
    low, high = points[0, 1], points[-1, 1]
    if low != 0.0 or abs(high - 1.0) > 1e-9:
        problem = f"passes {low:.3g} of 1 at its smallest and {high:.3g} at its largest diameter"
        raise InputError(problem, field="grading", value=str(file), allowed="a curve from 0 to 100 %")
    return {"diameters": points[:, 0].tolist(), "passing": [*points[:-1, 1].tolist(), 1.0]}


def _column(headings: Sequence[str], pattern: re.Pattern[str]) -> tuple[int, str]:
    """Return index and unit of the only column with a matching heading. Raises ValueError without such a column."""
    ((number, unit),) = [(k, match[1]) for k, name in enumerate(headings) if (match := pattern.search(name))]
    return number, unit

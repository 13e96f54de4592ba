"""The steps of test.inp: each keyword of the Incremental Driver, read from its lines and turned into a MixedStep.

The programmer's manual of 27 March 2020 and the guide to the input files define the formats. The numbers of iterations
in an increment are read but have no effect here.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np

from labkit.errors import InputError, nearest
from labkit.paths.mixed_step import MixedStep, components_of
from labkit.paths.variables import mixed_step
from labkit.plugins.incremental import exit_condition, restrictions
from labkit.plugins.incremental.conventions import STRESS_UNITS, SYSTEMS, rotate, system, tensor
from labkit.plugins.incremental.source import MOST_COLUMNS, Line, Source, imported_rows, shorten, split_words

MOST_INCREMENTS = 10_000_000
MOST_RECORDS = 500  # largest number of records in a step
SMOOTH = 100  # number of pieces that approximate a harmonic step or a deformation gradient
LARGEST_STRAIN = 5.0  # largest logarithmic strain of a step


@dataclasses.dataclass(frozen=True)
class StepHead:
    """The head of a step: its line, keyword, number of increments, duration in s, rows, and exit condition."""

    line: Line
    keyword: str
    increments: int
    duration: float
    every: int
    until: str | None

    @property
    def label(self) -> str:
        """Name of the step in messages."""
        return f"{self.keyword}, line {self.line.number}"

    @property
    def records(self) -> int:
        """Rows of the step in the output; with an exit condition, one for each increment, at which it is checked."""
        return min(-(-self.increments // (1 if self.until else self.every)), MOST_RECORDS)


class StepReader:
    """Reads the steps of a test file; `stress_unit` is the unit of the stresses in the file."""

    def __init__(self, source: Source, stress_unit: str) -> None:
        """Take the source without reading it yet."""
        self.source, self.stress_unit, self.pascals = source, stress_unit, STRESS_UNITS[stress_unit]

    def step(self, line: Line) -> MixedStep:
        """Read the step whose keyword is in this line. Raises InputError with the line and the invalid word."""
        keyword, question, condition = line.text.partition("?")
        name = (split_words(keyword.replace("|", " ")) or [""])[0]
        read = _KEYWORDS.get(name.lower())
        if read is None:
            raise line.error(_unknown(name))
        canonical = next(keyword for keyword in NAMES if keyword.lower() == name.lower())
        try:
            until = exit_condition.translate(condition, self.stress_unit) if question else None
        except InputError as error:
            raise line.error(str(error)) from None
        common = self._common(line, canonical, until)
        try:
            return read(self, common)
        except InputError as error:
            text = str(error)
            if text.startswith(str(self.source.file)):
                raise
            raise line.error(f"{canonical}: {text}") from None

    def _common(self, line: Line, keyword: str, until: str | None) -> StepHead:
        """Read the line `ninc maxiter deltaTime : every`."""
        what = "the number of increments, of iterations, and the time"
        data = self.source.data(what)
        left, colon, right = data.text.partition(":")
        words = split_words(left)
        if len(words) < 3:
            problem = f"{data.text[:40]!r} where {what} should be: give three numbers, e.g. 100 10 1.0 : 10"
            raise data.error(problem)
        increments = data.whole(words[0], 1, MOST_INCREMENTS, "a number of increments")
        data.whole(words[1], 0, MOST_INCREMENTS, "a number of iterations")
        duration = data.real(words[2])
        temperature = f" {data.text} ".partition(" T ")[2].split()
        if temperature and data.real(temperature[0]) != 0.0:
            raise data.error("a change of temperature has no effect here: leave out T and its value")
        every = split_words(right)[:1]
        number = data.whole(every[0], 1, MOST_INCREMENTS, "a number after the colon") if every else 1
        if colon and not every:
            raise data.error("no number follows the colon: give one, e.g. 100 10 1.0 : 10")
        if duration <= 0.0 and keyword != "*ImportFile":
            raise data.error(f"the time {words[2]} is not valid: give a number above 0")
        return StepHead(line, keyword, increments, duration, number, until)

    def system(self) -> str:
        """Read the keyword of a set of variables, such as *Roscoe."""
        line = self.source.need("the variables, e.g. *Cartesian")
        name = line.first
        if name.lower() not in SYSTEMS:
            systems = "*Cartesian, *Roscoe, *RoscoeIsomorph or *Rendulic"
            raise line.error(f"{shorten(name)} are not known variables: give {systems}")
        return name

    def flag(self, line: Line, text: str) -> bool:
        """Return True for 1, a prescribed stress, and False for 0, a prescribed strain."""
        if text not in ("0", "1"):
            raise line.error(f"{shorten(text)} is not valid: give 0 for a strain or 1 for a stress")
        return text == "1"

    def rows(self, count: int) -> tuple[tuple[bool, ...], np.ndarray]:
        """Read six lines of a flag and `count` numbers; returns the flags and the numbers (6, count)."""
        flags, values = [], []
        for k in range(6):
            what = f"component {k + 1} of 6"
            line = self.source.data(what)
            numbers = line.reals(count + 1, f"{what}, a flag and {count} number{'s' * (count > 1)},")
            flags.append(self.flag(line, line.first))
            values.append(numbers[1:])
        return tuple(flags), np.array(values)

    def mixed_control(
        self,
        common: StepHead,
        keyword: str,
        flags: Sequence[bool],
        changes: np.ndarray,
        durations: Sequence[float] | None = None,
    ) -> MixedStep:
        """Return a MixedStep from changes (n, 6) of the driver's variables; the durations, s, are equal by default."""
        variables, signs = system(keyword)
        on_stress = tuple(flags)
        scale = signs * np.where(on_stress, self.pascals, 1.0)
        changes = np.atleast_2d(changes)
        if durations is None:
            durations = [common.duration / len(changes)] * len(changes)
        return mixed_step(
            variables,
            on_stress,
            changes * scale,
            durations=tuple(float(duration) for duration in durations),
            until=common.until,
            records=common.records,
            label=common.label,
        )


def _linear(reader: StepReader, common: StepHead) -> MixedStep:
    keyword = reader.system()
    flags, loads = reader.rows(1)
    return reader.mixed_control(common, keyword, flags, loads[:, 0])


def _circulating(reader: StepReader, common: StepHead) -> MixedStep:
    """Return one period of A (sin(2 pi t/T + phi) - sin(phi)) + B t/T, in straight pieces of equal time."""
    keyword = reader.system()
    flags, values = reader.rows(3)
    amplitude, phase, load = values.T
    share = np.linspace(0.0, 1.0, min(max(common.increments, 20), SMOOTH) + 1)[:, None]
    path = amplitude * (np.sin(2.0 * np.pi * share + phase) - np.sin(phase)) + load * share
    return reader.mixed_control(common, keyword, flags, np.diff(path, axis=0))


def _deformation_gradient(reader: StepReader, common: StepHead) -> MixedStep:
    """Return F(t) = 1 + (F - 1) t/T in pieces of constant velocity gradient, at whose ends F(t) is exact."""
    from scipy.linalg import logm  # importing it takes a second

    components = [reader.source.reals(1, f"component {k + 1} of 9 of the deformation gradient")[0] for k in range(9)]
    F = np.array(
        [
            [components[0], components[3], components[5]],
            [components[4], components[1], components[7]],
            [components[6], components[8], components[2]],
        ]
    )
    pieces = min(max(common.increments, 20), SMOOTH // 2)
    gradients = [np.eye(3) + (F - np.eye(3)) * k / pieces for k in range(pieces + 1)]
    if not all(1e-3 < np.linalg.det(gradient) < 1e3 for gradient in gradients):
        raise InputError("the deformation gradient is not a possible deformation: give one with a determinant near 1")
    steps = [-rotate(np.real(logm(after @ np.linalg.inv(before)))) for before, after in itertools.pairwise(gradients)]
    return MixedStep(
        strain=tuple(np.ravel(steps)),
        durations=(common.duration / pieces,) * pieces,
        until=common.until,
        records=common.records,
        label=common.label,
    )


def _import_file(reader: StepReader, common: StepHead) -> MixedStep:
    source, text = reader.source, common.line.text.partition("?")[0]
    name, bar, number = text[len("*ImportFile") :].partition("|")
    if not bar or not number.split():
        problem = "*ImportFile lacks the number of columns: write *ImportFile FILE | COLUMNS"
        raise common.line.error(problem)
    columns = common.line.whole(number.split()[0], 1, MOST_COLUMNS, "a number of columns")
    keyword = reader.system()
    flags, chosen, factors = [], [], []
    for k in range(6):
        line = source.data(f"component {k + 1} of 6, a flag and a column")
        flag, *rest = line.words
        flags.append(reader.flag(line, flag))
        column, factor = _column(line, " ".join(rest), columns, low=0)
        chosen.append(column)
        factors.append(factor)
    clock = None
    if common.duration <= 0.0:
        line = source.data("the column of the time, because the time is not above 0")
        clock = _column(line, line.text, columns, low=1)
    rows = imported_rows(source, common.line, name.strip(), columns, common.increments)
    path = np.column_stack([rows, np.zeros(len(rows))])[:, [column - 1 for column in chosen]] * factors
    durations = [common.duration] * (len(rows) - 1)
    if clock is not None:
        durations = list(np.diff(rows[:, clock[0] - 1]) * clock[1])
        if min(durations) < 0.0:
            raise common.line.error("the time of the imported file decreases: give another column")
    common = dataclasses.replace(common, increments=min(common.increments, len(rows) - 1))
    return reader.mixed_control(common, keyword, flags, np.diff(path, axis=0), durations)


def _column(line: Line, text: str, most: int, low: int) -> tuple[int, float]:
    """Parse the number of a column, from 1 (0: no column), and its factor, from text such as `5 * 0.01`."""
    number, star, factor = text.partition("*")
    words = split_words(number)
    if not words:
        raise line.error(f"{line.text[:40]!r} lacks the number of a column: give one, {low} to {most}")
    column = line.whole(words[0], low, most, "a column")
    words = split_words(factor)
    if star and not words:
        raise line.error(f"{line.text[:40]!r} lacks the factor after *: give one, e.g. 5 * 0.01")
    return column, line.real(words[0]) if words else 1.0


def _short(keyword: str, flags: tuple[int, ...], place: int | None) -> Callable[[StepReader, StepHead], MixedStep]:
    """Return a reader of steps that need at most one number from the file: the change of variable number `place`."""

    def read(reader: StepReader, common: StepHead) -> MixedStep:
        loads = np.zeros(6)
        if place is not None:
            loads[place] = reader.source.reals(1, f"the change of component {place + 1}")[0]
        return reader.mixed_control(common, keyword, [bool(flag) for flag in flags], loads)

    return read


def _restriction(reader: StepReader, common: StepHead) -> MixedStep:
    mt, me, m = restrictions.restrictions(reader.source)
    strains = me.any(axis=1)
    solved = restrictions.solve(me[strains], m[strains])
    if solved is None:
        raise InputError("the restrictions on strains contradict or repeat one another: give independent ones")
    solution, basis = solved
    return MixedStep(
        strain=tuple(tensor(solution, shear=0.5).ravel()),
        free=components_of(tensor(basis, shear=0.5)),
        measured=components_of(-tensor(mt[~strains], shear=0.5)),  # M with M : sigma = -(mt . T)
        stress=tuple(-m[~strains] * reader.pascals),
        durations=(common.duration,),
        until=common.until,
        records=common.records,
        label=common.label,
    )


def _perturbations(reader: StepReader, common: StepHead) -> MixedStep:
    raise InputError("probes from one state are not steps of a path: leave them out, and use `labkit probe` for them")


def _random_walk(reader: StepReader, common: StepHead) -> MixedStep:
    raise InputError("a random path cannot be repeated: leave it out, or import its increments with *ImportFile")


NAMES: dict[str, Callable[[StepReader, StepHead], MixedStep]] = {
    "*LinearLoad": _linear,
    "*CirculatingLoad": _circulating,
    "*DeformationGradient": _deformation_gradient,
    "*ImportFile": _import_file,
    "*OedometricE1": _short("*Cartesian", (0, 0, 0, 0, 0, 0), 0),
    "*OedometricS1": _short("*Cartesian", (1, 0, 0, 0, 0, 0), 0),
    "*TriaxialE1": _short("*Cartesian", (0, 1, 1, 0, 0, 0), 0),
    "*TriaxialS1": _short("*Cartesian", (1, 1, 1, 0, 0, 0), 0),
    "*TriaxialUEq": _short("*Roscoe", (0, 0, 0, 0, 0, 0), 1),
    "*TriaxialUq": _short("*Roscoe", (0, 1, 0, 0, 0, 0), 1),
    "*PureRelaxation": _short("*Cartesian", (0, 0, 0, 0, 0, 0), None),
    "*PureCreep": _short("*Cartesian", (1, 1, 1, 1, 1, 1), None),
    "*UndrainedCreep": _short("*Roscoe", (0, 1, 1, 1, 1, 1), None),
    "*ObeyRestrictions": _restriction,
    "*PerturbationsS": _perturbations,
    "*PerturbationsE": _perturbations,
    "*RandomWalk": _random_walk,
}
_KEYWORDS = {name.lower(): read for name, read in NAMES.items()}


def _unknown(name: str) -> str:
    """Say why a word is not a keyword."""
    if not name.startswith("*"):
        return f"{shorten(name)} is not a keyword: a step begins with one, e.g. *TriaxialE1"
    if name.lower() == "*repetition":
        return "*Repetition within *Repetition is not supported: write the inner steps out"
    close = nearest(name, NAMES)
    hint = f"did you mean {close}?" if close else f"use one of {', '.join(NAMES)}, *Repetition, *End"
    return f"{shorten(name)} is not a keyword of the Incremental Driver: {hint}"

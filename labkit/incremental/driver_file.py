"""test.inp: the name of the output file, then steps, each with its keyword, to *End or the end of the file."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

from labkit.dem.step import Step
from labkit.dem.steps import MOST_STEPS, Steps
from labkit.errors import InputError
from labkit.incremental.conventions import STRESS_UNITS
from labkit.incremental.keywords import Reader
from labkit.incremental.source import Line, Source, separated

MOST_REPETITIONS = 1_000_000


@dataclasses.dataclass(frozen=True)
class DriverFile:
    """The contents of a test file.

    output: name of the driver's output file, as written; heading: its heading, or ""; steps: the steps as written;
    order: their numbers, from 0, in the order in which they are carried out; notes: sentences about steps that mean
    less here than for a material with viscosity.
    """

    file: Path
    output: str
    heading: str
    steps: tuple[Step, ...]
    order: tuple[int, ...]
    notes: tuple[str, ...]

    def path(self, rate: float | str | None = None, pressure: float | None = None) -> Steps:
        """The loading path. rate: largest prescribed strain rate, 1/s; pressure: of a consolidation before it, Pa."""
        given = {} if pressure is None else {"pressure": f"{pressure!r} Pa"}
        return Steps(rate=rate, steps=self.steps, order=self.order, **given)  # type: ignore[arg-type]


def read_test(file: str | os.PathLike[str], stress_unit: str = "kPa") -> DriverFile:
    """Reads a test file. Raises InputError with the line and the word that is not valid.

    stress_unit: of the stresses in the file, one of Pa, kPa, MPa.
    """
    if stress_unit not in STRESS_UNITS:
        allowed = f"one of {', '.join(STRESS_UNITS)}"
        raise InputError("is unknown", field="stress_unit", value=stress_unit, allowed=allowed)
    source = Source(Path(file))
    output, heading = _output(source)
    reader = Reader(source, stress_unit)
    steps: list[Step] = []
    order: list[int] = []
    while (line := source.next()) is not None:
        keyword = separated(line.text)[0].lower()
        if keyword == "*end":
            break
        if keyword == "*repetition":
            number, times = _repetition(source, line)
            repeated = range(len(steps), len(steps) + number)
            steps += [reader.step(_inner(source, line, k, number)) for k in range(number)]
            if len(order) + number * times > MOST_STEPS:
                raise source.error(line.number, f"this makes more than {MOST_STEPS} steps: give fewer repetitions")
            order += list(repeated) * times
        else:
            order.append(len(steps))
            steps.append(reader.step(line))
    if not steps:
        raise source.error(max(source.number, 1), "there are no steps: give at least one, e.g. *TriaxialE1")
    return DriverFile(source.file, output, heading, tuple(steps), tuple(order), _notes(steps))


def _output(source: Source) -> tuple[str, str]:
    """Name of the output file and heading, in the first line."""
    first = source.whole_line()
    if first is None or not first.strip():
        raise source.error(1, "the first line is empty: it names the output file, e.g. output.out")
    name, _, heading = first.partition("#")
    name = name.strip()
    if name.startswith("*"):
        raise source.error(1, f"{name[:40]!r} is not the name of an output file: the first line must be one")
    if not name:
        raise source.error(1, "no output file is named before #: give one, e.g. output.out # heading")
    return name, heading.strip()


def _repetition(source: Source, line: Line) -> tuple[int, int]:
    """Number of steps and of repetitions."""
    data = source.data("the numbers of steps and of repetitions")
    words = separated(data.text)
    if len(words) < 2:
        raise source.error(data.number, f"{data.text[:40]!r} where the numbers of steps and of repetitions should be")
    number = source.whole(data, words[0], 1, MOST_STEPS, "a number of steps")
    return number, source.whole(data, words[1], 1, MOST_REPETITIONS, "a number of repetitions")


def _inner(source: Source, start: Line, done: int, number: int) -> Line:
    """The keyword of a step within *Repetition."""
    line = source.next()
    if line is None or separated(line.text)[0].lower() == "*end":
        where = source.number if line is None else line.number
        problem = f"*Repetition in line {start.number} announces {number} steps, and {done} follow: give the others"
        raise source.error(max(where, 1), problem)
    return line


def _notes(steps: list[Step]) -> tuple[str, ...]:
    """A sentence for each step that holds stresses or strains over time."""
    return tuple(
        f"{step.label}: the stresses or strains are held, but nothing creeps or relaxes, because there is no viscosity"
        for step in steps
        if not any(step.strain) and not any(step.stress)
    )

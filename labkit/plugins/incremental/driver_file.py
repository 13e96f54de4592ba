"""Reads test.inp: the name of the output file, then steps, each with its keyword, up to *End or the end of the file."""

from __future__ import annotations

import dataclasses
import itertools
import os
from pathlib import Path

from labkit.errors import InputError
from labkit.paths.mixed_step import MixedStep
from labkit.paths.steps import MOST_STEPS, Steps
from labkit.plugins.incremental.conventions import STRESS_UNITS
from labkit.plugins.incremental.keywords import StepReader
from labkit.plugins.incremental.source import Line, Source

MOST_REPETITIONS = 1_000_000


@dataclasses.dataclass(frozen=True)
class DriverFile:
    """The contents of a test file.

    Args:
        output: Name of the driver's output file, as written.
        heading: Heading of the output file, or "".
        steps: Steps as written.
        order: Numbers of the steps, from 0, in the order in which they are carried out.
        notes: Sentences about steps that have no effect without viscosity.
    """

    file: Path
    output: str
    heading: str
    steps: tuple[MixedStep, ...]
    order: tuple[int, ...]
    notes: tuple[str, ...]

    def path(self, rate: float | str | None = None, pressure: float | None = None) -> Steps:
        """Return the loading path after consolidation to `pressure`, Pa; `rate` is the largest strain rate, 1/s."""
        parameters = {} if pressure is None else {"pressure": f"{pressure!r} Pa"}
        return Steps(rate=rate, steps=self.steps, order=self.order, **parameters)


def read_test(file: str | os.PathLike[str], stress_unit: str = "kPa", block: int = 1) -> DriverFile:
    """Read a test file. Raises InputError with the line and the word that is not valid.

    stress_unit: unit of the stresses in the file, Pa, kPa or MPa; block: number of the test, from 1, in a file with
    several tests, each of which begins with the name of its output file and ends with *End.
    """
    if stress_unit not in STRESS_UNITS:
        allowed = f"one of {', '.join(STRESS_UNITS)}"
        raise InputError("is unknown", field="stress_unit", value=stress_unit, allowed=allowed)
    source = Source(Path(file))
    starts = _blocks(source)
    if not 1 <= block <= len(starts):
        raise InputError(f"is not in {file}", field="block", value=block, allowed=f"a number from 1 to {len(starts)}")
    source.go_to(starts[block - 1] + 1)
    output, heading = _output(source, "".join(source.raw[starts[block - 1] : starts[block - 1] + 1]))
    reader = StepReader(source, stress_unit)
    steps: list[MixedStep] = []
    order: list[int] = []
    while (line := source.next()) is not None:
        keyword = line.first.lower()
        if keyword == "*end":
            break
        if keyword == "*repetition":
            number, times = _repetition(source, line)
            repeated = range(len(steps), len(steps) + number)
            steps += [reader.step(_inner(source, line, k, number)) for k in range(number)]
            if len(order) + number * times > MOST_STEPS:
                raise line.error(f"this makes more than {MOST_STEPS} steps: give fewer repetitions")
            order += list(repeated) * times
        else:
            order.append(len(steps))
            steps.append(reader.step(line))
    if not steps:
        raise source.last.error("there are no steps: give at least one, e.g. *TriaxialE1")
    others = f"{source.file} has {len(starts)} tests, of which number {block} is carried out: --block chooses another"
    notes = (*[others] * (len(starts) > 1), *_notes(steps))
    return DriverFile(source.file, output, heading, tuple(steps), tuple(order), notes)


def _blocks(source: Source) -> list[int]:
    """Return the numbers of the lines, from 0, at which tests begin; text after *End without a keyword is ignored."""
    lines = [line.strip().lower() for line in source.raw]
    ends = [number for number, line in enumerate(lines) if line.startswith("*end")]
    starts = [0]
    for begin, end in itertools.pairwise([number + 1 for number in ends] + [len(lines)]):
        first = next((k for k in range(begin, end) if lines[k]), end)
        if any(line.startswith("*") for line in lines[first + 1 : end - 1]):
            starts.append(first)
    return starts


def _output(source: Source, first: str) -> tuple[str, str]:
    """Return the name of the output file and the heading, which are in the first line, with its comment."""
    if not first.strip():
        raise source.last.error("the first line is empty: it names the output file, e.g. output.out")
    name, _, heading = first.partition("#")
    name = name.strip()
    if name.startswith("*"):
        raise source.last.error(f"{name[:40]!r} is not the name of an output file: the first line must be one")
    if not name:
        raise source.last.error("no output file is named before #: give one, e.g. output.out # heading")
    return name, heading.strip()


def _repetition(source: Source, line: Line) -> tuple[int, int]:
    """Read the number of steps and the number of repetitions."""
    data = source.data("the numbers of steps and of repetitions")
    words = data.words
    if len(words) < 2:
        raise data.error(f"{data.text[:40]!r} where the numbers of steps and of repetitions should be")
    number = data.whole(words[0], 1, MOST_STEPS, "a number of steps")
    return number, data.whole(words[1], 1, MOST_REPETITIONS, "a number of repetitions")


def _inner(source: Source, start: Line, done: int, number: int) -> Line:
    """Read the line with the keyword of a step within *Repetition."""
    line = source.next()
    if line is None or line.first.lower() == "*end":
        problem = f"*Repetition in line {start.number} announces {number} steps, and {done} follow: give the others"
        raise source.last.error(problem)
    return line


def _notes(steps: list[MixedStep]) -> tuple[str, ...]:
    """Return a sentence for each step in which all stresses or strains are held constant."""
    return tuple(
        f"{step.label}: the stresses or strains are held, but nothing creeps or relaxes, because there is no viscosity"
        for step in steps
        if not any(step.strain) and not any(step.stress)
    )

"""The walk of a material along a path: the same for grains and for the constitutive model."""

from __future__ import annotations

import abc
import dataclasses
import itertools
from collections.abc import Generator, Iterator
from typing import Any

import numpy as np

from labkit.paths.ending import Cause, Ending
from labkit.paths.path import Path
from labkit.paths.step import Here, Record, Step, why_short
from labkit.quantities.conditions import Condition
from labkit.quantities.scalars import Facts

Walk = Generator[Any, object, None]  # yields the requests of the material and receives the answers


@dataclasses.dataclass(frozen=True)
class Stop:
    """The point at which a material has stopped.

    Args:
        record: The variables recorded at this point, by name.
        end: STRAIN or STRESS if the strain, or a stress, that ends the step is reached, LIMIT at the limit of the
            accumulated strain; None within a step.
    """

    record: Record
    end: Cause | None = None


class Material(abc.ABC):
    """A material that can be carried along a path. `advance` is a generator that yields the requests of the material.

    `here` is the start of the next step, `last` the latest record, `facts` what conditions need to know of the path.
    """

    here: Here
    last: Record
    facts: Facts

    def drain(self, step: Step, stress: np.ndarray) -> None:
        """Note where undrained loading begins; `stress` (3, 3), Pa, is that at the start of a step."""
        reference = stress if self.facts.reference is None else self.facts.reference
        self.facts = dataclasses.replace(self.facts, reference=reference if step.undrained else None)

    @abc.abstractmethod
    def enter(self, number: int, step: Step) -> None:
        """Begin or continue a step; `number` counts steps from 0."""

    @abc.abstractmethod
    def advance(self) -> Generator[object, object, Stop]:
        """Follow the step to its next record; return the Stop at this record."""

    @abc.abstractmethod
    def lost(self, record: Record) -> str:
        """Say in a sentence why the material cannot follow the path beyond a record; empty if it can."""

    @abc.abstractmethod
    def arrive(self, stop: Stop, ending: Ending | None) -> None:
        """Store a record, which becomes `last`.

        Args:
            stop: The point reached.
            ending: Why the step ended here; None if it goes on.
        """

    @property
    @abc.abstractmethod
    def accumulated_strain(self) -> float:
        """Accumulated strain of the path, or of the current step if the steps have programmes."""


@dataclasses.dataclass
class _Walk:
    """A walk, at one of the steps of its path."""

    path: Path
    material: Material
    steps: int
    stop_when: Condition | None
    remaining: Iterator[tuple[int, Step]]
    number: int = 0

    def ending(self, step: Step, stop: Stop) -> Ending | None:
        """Return why the step ends at a stop; None if it goes on."""
        ending = self._planned(step, stop)
        if ending is None or not ending.over:
            if reason := self.material.lost(stop.record):
                return Ending(self.number + 1, Cause.LOST, reason)
        return ending

    def _planned(self, step: Step, stop: Stop) -> Ending | None:
        """Return why the step ends here as the path, or the user, wants it; None if it goes on."""
        record, final, number = stop.record, self.number + 1 == self.steps, self.number + 1
        facts = self.material.facts
        if self.stop_when is not None and self.stop_when.holds(record, facts):
            return Ending(number, Cause.STOP_WHEN, self.stop_when.text, *self._compared(self.stop_when, record))
        met = next((end.condition for end in step.conditions if end.condition.holds(record, facts)), None)
        is_reached = stop.end in (Cause.STRAIN, Cause.STRESS)
        is_over = is_reached or met is not None
        last = stop.end is Cause.LIMIT or (is_over and final) or step.ends_path(record) is not None
        if not (is_over or last):
            return None
        if last and not (final and is_over and step.length is None):
            short = next(self.remaining, (number, step))[1] if is_over and not final else step
            if reason := why_short(self.path.name, self.path.strain, short, record):
                return Ending(number, Cause.LIMIT, reason)
        if is_reached or met is None:
            missed = " or ".join(end.text for end in step.conditions) if is_reached and met is None else ""
            return Ending(number, stop.end or Cause.LIMIT, missed, over=last)
        return Ending(number, Cause.CONDITION, met.text, *self._compared(met, record), over=last)

    def _compared(self, condition: Condition, record: Record) -> tuple[str, str]:
        """Return the values that a condition compares, at a record and one record before."""
        facts = self.material.facts
        return condition.reached(record, facts), condition.reached(self.material.last, facts)


def walk(path: Path, material: Material, steps: int, first: int = 0, stop_when: Condition | None = None) -> Walk:
    """Carry a material along the steps of a path.

    Args:
        path: The path.
        material: The grains, or a point of the model.
        steps: Number of steps of the path.
        first: Number of the step to begin with, if the walk is resumed.
        stop_when: Condition that ends the walk at a record.
    """
    remaining = itertools.islice(enumerate(path.steps_from(material.here)), first, None)
    here = _Walk(path, material, steps, stop_when, remaining)
    for here.number, step in remaining:
        material.enter(here.number, step)
        ending = None
        while ending is None:
            stop = yield from material.advance()
            ending = here.ending(step, stop)
            material.arrive(stop, ending)
        if ending.over:
            return
        material.here.stress = step.settled_stress(stop.record["stress"], material.accumulated_strain)

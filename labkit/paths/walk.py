"""The walk of a material along a path: the same for grains and for the constitutive model."""

from __future__ import annotations

import abc
import dataclasses
import itertools
from collections.abc import Generator
from typing import Any

from labkit.paths.path import Path
from labkit.paths.step import Here, Record, Step, why_short
from labkit.paths.steps import is_symmetric
from labkit.quantities.conditions import Condition

Walk = Generator[Any, object, None]  # yields the requests of the material and receives the answers


@dataclasses.dataclass(frozen=True)
class Stop:
    """The point at which a material has stopped.

    Args:
        record: The variables recorded at this point, by name.
        reached: True if the strain, or a stress, that ends the step is reached.
        ended: True if the walk cannot continue, or is at the limit of the accumulated strain.
    """

    record: Record
    reached: bool = False
    ended: bool = False


class Material(abc.ABC):
    """A material that can be carried along a path. `advance` is a generator that yields the requests of the material.

    `here` is the start of the next step, `first` the first record.
    """

    here: Here
    first: Record

    @abc.abstractmethod
    def enter(self, number: int, step: Step) -> None:
        """Begin or continue a step; `number` counts steps from 0."""

    @abc.abstractmethod
    def advance(self) -> Generator[object, object, Stop]:
        """Follow the step to its next record; return the Stop at this record."""

    @abc.abstractmethod
    def arrive(self, stop: Stop, over: bool, last: bool, reason: str) -> None:
        """Store a record.

        Args:
            stop: The point reached.
            over: True if the step is over.
            last: True if the path is over.
            reason: Sentence that says why the path ended before its target; empty if it did not.
        """

    @property
    @abc.abstractmethod
    def accumulated_strain(self) -> float:
        """Accumulated strain of the path, or of the current phase on a path of phases."""


def walk(path: Path, material: Material, steps: int, first: int = 0, stop_when: Condition | None = None) -> Walk:
    """Carry a material along the steps of a path.

    Args:
        path: The path.
        material: The grains, or a point of the model.
        steps: Number of steps of the path.
        first: Number of the step to begin with, if the walk is resumed.
        stop_when: Condition that ends the walk at a record.
    """
    symmetric = is_symmetric(path)
    remaining = itertools.islice(enumerate(path.steps_from(material.here)), first, None)
    for number, step in remaining:
        material.enter(number, step)
        over = False
        while not over:
            stop = yield from material.advance()
            record, final = stop.record, number + 1 == steps
            over = stop.reached or any(end.holds(record, material.first, symmetric) for end in step.conditions)
            met = stop_when is not None and stop_when.holds(record, material.first)
            last = stop.ended or met or (over and final) or step.ends_path(record) is not None
            reason = ""
            if last and not met and not (final and over and step.length is None):
                begun = next(remaining, (number, step))[1] if over and not final else step
                reason = why_short(path.name, path.strain, begun, record)
            material.arrive(stop, over, last, reason)
            if last:
                return
        material.here.stress = step.settled_stress(record["stress"], material.accumulated_strain)

"""A step of a path: prescribed strain rates, held stresses, and the condition that ends it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from labkit.micro.tensors import symmetric, to_six, to_tensor
from labkit.paths.control import Control
from labkit.paths.strain_measures import StrainMeasure
from labkit.quantities.conditions import Condition, condition
from labkit.quantities.scalars import Facts

if TYPE_CHECKING:
    from labkit.paths.programme import Programme

Record = Mapping[str, Any]  # variables of a record, by name
ISOCHORIC = 1e-12  # largest rate of volume change, divided by the rate of the path, that is a rounding error


class Until:
    """A condition that ends a step; `a | b` is met as soon as a or b is met."""

    @property
    def each(self) -> tuple[Until, ...]:
        """The single conditions."""
        return (self,)

    def __or__(self, other: Until) -> AnyOf:
        return AnyOf((*self.each, *other.each))


@dataclasses.dataclass(frozen=True)
class AnyOf(Until):
    """Several conditions, each of which ends the step."""

    conditions: tuple[Until, ...]

    @property
    def each(self) -> tuple[Until, ...]:
        return self.conditions


@dataclasses.dataclass(frozen=True)
class StrainReached(Until):
    """The strain accumulated in the step reaches `length`; `turn` is the scalar strain at this point, if known."""

    length: float
    turn: float | None = None


@dataclasses.dataclass(frozen=True)
class StrainLimit(Until):
    """The strain accumulated in all steps that end at stresses reaches `total`; this ends the path."""

    total: float


@dataclasses.dataclass(frozen=True)
class StressReached(Until):
    """A scalar of the stress rises, or falls, to `level`.

    Args:
        name: Name of the scalar, for messages; the name of a ratio of stresses contains a /.
        measured: Function that returns the scalar of a stress (3, 3), Pa.
        level: Pa, or a ratio.
        falling: True if the scalar falls to the level.
    """

    name: str
    measured: Callable[[np.ndarray], Any]
    level: float
    falling: bool = False

    def is_met(self, stress: np.ndarray) -> bool:
        """Return True if the scalar of a stress (3, 3), Pa, is at or beyond the level."""
        sign = -1.0 if self.falling else 1.0
        return bool(sign * (self.measured(stress) - self.level) >= 0.0)


@dataclasses.dataclass(frozen=True)
class RecordMeets(Until):
    """A condition (labkit.quantities.conditions) holds at a record, such as q/p > 0.9."""

    text: str

    @property
    def condition(self) -> Condition:
        """The condition. Raises InputError if the text is not a condition."""
        return condition(self.text, "until")


@dataclasses.dataclass(frozen=True)
class StrainExceeds(Until):
    """The magnitude of a scalar strain exceeds a limit at a record; this ends the path."""

    measure: StrainMeasure
    limit: float

    def beyond(self, record: Record) -> bool:
        """Return True if the limit is exceeded at a record."""
        return bool(abs(self.measure.at(record["strain"])) > self.limit)


@dataclasses.dataclass(eq=False)
class Here:
    """The start of the next step; a walk along a path keeps it up to date.

    Args:
        stress: Stress at the start, (3, 3), Pa.
        step_strain: Accumulated strain of a time step; 0 for a material without time steps.
        first: Stress at the start of the path, (3, 3), Pa (default: `stress`).
        undrained: Stress at the start of the undrained loading that the path continues, (3, 3), Pa; None without it.
        pores: Volume of the cell, m3, and void ratio at the start of the path.
    """

    stress: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((3, 3)))
    step_strain: float = 0.0
    first: np.ndarray | None = None
    undrained: np.ndarray | None = None
    pores: tuple[float, float] = (1.0, 1.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Step:
    """One step of a path.

    Args:
        given: Prescribed velocity gradient divided by the rate of the path, (3, 3), compression positive, or a function
            of the accumulated strain that returns it.
        held: The stresses that the servo holds, and the strain rates that it adjusts; None if no stress is held.
        until: Condition that ends the step. A path that does not end at a strain needs a StrainLimit.
        rate_limit: Largest strain rate of the servo, divided by the rate of the path.
        programme: The programme of a step of mixed control, if it is one. The accumulated strain is then counted from
            the start of the step.
    """

    given: np.ndarray | Callable[[float], np.ndarray]
    held: Control | None
    until: Until
    rate_limit: float = 3.0
    programme: Programme | None = None

    def rates(self, accumulated: float) -> np.ndarray:
        """Return the prescribed velocity gradient divided by the rate, (3, 3), at an accumulated strain."""
        return self.given(accumulated) if callable(self.given) else self.given

    @property
    def length(self) -> float | None:
        """Accumulated strain at which the step ends; None for a step that ends at a stress."""
        return next((target.length for target in self.until.each if isinstance(target, StrainReached)), None)

    @property
    def limit(self) -> float:
        """Accumulated strain at which the step ends or, for a step that ends at a stress, at which the path ends."""
        limits = (target.total for target in self.until.each if isinstance(target, StrainLimit))
        return next(limits, np.inf) if self.length is None else self.length

    @property
    def stress_ends(self) -> tuple[StressReached, ...]:
        """The stresses that end the step."""
        return tuple(target for target in self.until.each if isinstance(target, StressReached))

    @property
    def conditions(self) -> tuple[RecordMeets, ...]:
        """The conditions on a record that end the step."""
        return tuple(target for target in self.until.each if isinstance(target, RecordMeets))

    @property
    def undrained(self) -> bool:
        """True if the step keeps the volume or, with pore water, what is in it."""
        rates = self.rates(0.0) if self.programme is None else self.programme.mixed.strains
        keeps = self.held is None or self.held.isochoric or self.held.water is not None
        return keeps and bool(np.abs(np.trace(rates, axis1=-2, axis2=-1)).max() < ISOCHORIC)

    def facts(self, facts: Facts) -> Facts:
        """Return the facts of a path for this step, which is perhaps drained."""
        return facts if self.undrained else dataclasses.replace(facts, undrained=False, reference=None)

    @property
    def varies(self) -> bool:
        """True if the prescribed rates or the held stresses change with the accumulated strain."""
        if self.programme is not None:
            return self.programme.varies
        moving = callable(self.given) and not np.array_equal(self.given(0.0), self.given(0.5 * self.limit))
        return moving or (self.held is not None and callable(self.held.target))

    def ends_at(self, stress: np.ndarray) -> bool:
        """Return True if the step ends at this stress (3, 3), Pa."""
        return any(end.is_met(stress) for end in self.stress_ends)

    def ends_path(self, record: Record) -> StrainExceeds | None:
        """Return the strain limit that ends the path at a record, or None."""
        limits = (target for target in self.until.each if isinstance(target, StrainExceeds) and target.beyond(record))
        return next(limits, None)

    def settled_stress(self, stress: np.ndarray, accumulated: float) -> np.ndarray:
        """Return the stress (3, 3), Pa, at which the next step starts, from the stress measured at its end.

        For the held stresses of a programme, their targets replace the measured values, so that errors of the servo do
        not add up over many steps.
        """
        if self.programme is None or self.held is None:
            return stress
        six = to_six(symmetric(stress))
        return to_tensor(correct_stress(six, self.held.measure, self.held.at(accumulated) - self.held.measure @ six))


def correct_stress(six: np.ndarray, measure: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Return the stress nearest to `six` (6,) for which `measure` (k, 6) @ stress is larger by `missing` (k,)."""
    return six + np.linalg.lstsq(measure, missing, rcond=None)[0]


def why_short(name: str, strain: float, step: Step, record: Record) -> str:
    """Say why a path ended before it reached the stress that ends this step; empty if the stress was reached.

    Args:
        name: Name of the path.
        strain: Accumulated strain at which the path ends.
        step: The step.
        record: The last record.
    """
    end = next(iter(step.stress_ends), None)
    if end is None:
        return ""
    now = end.measured(record["stress"])
    if step.length is not None:
        if step.ends_at(record["stress"]):
            return ""
        what = end.name.removeprefix("the ")
        return (
            f"the strain limit {strain:g} was reached at a {what} of {now / 1e3:.4g} kPa, before the stress of "
            f"{end.level / 1e3:.4g} kPa at which {name} stops: give a larger strain"
        )
    unit, factor = ("", 1.0) if "/" in end.name else (" kPa", 1e-3)
    beyond = step.ends_path(record)
    reason = f"the accumulated strain reached its limit of {strain:g}"
    if beyond is not None:
        value = beyond.measure.at(record["strain"])
        reason = f"{beyond.measure.name} {value:.2%} exceeded strain_limit {beyond.limit:g}"
    return f"{reason} while {end.name} was {factor * now:.4g}{unit}, short of {factor * end.level:.4g}{unit}"

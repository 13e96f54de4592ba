"""Why a step of a path, or the path itself, ended: a value, stored in the run file when it happens."""

from __future__ import annotations

import dataclasses
import enum
import json

from labkit.parameters import Values

MOST_STORED = 5  # endings of steps, the last ones; a path may have 100,000 steps


class Cause(enum.StrEnum):
    """What ended a step, or the path."""

    STRAIN = "strain"  # the strain of the step is reached
    STRESS = "stress"  # a stress that ends the step is reached
    CONDITION = "condition"  # a condition of the step is met at a record
    STOP_WHEN = "stop_when"  # the condition that ends the run is met at a record
    LIMIT = "limit"  # a limit of the strain is reached before the aim of the path
    LOST = "lost"  # the material cannot follow the path any further
    SIGNAL = "signal"  # a signal stopped the run, which can be resumed


@dataclasses.dataclass(frozen=True)
class Ending:
    """Why a step, or the path, ended.

    Args:
        step: Number of the step, from 1.
        cause: What ended it.
        what: The condition that was met or, if a strain or a stress ended the step, was not; else the reason.
        reached: The values that were compared, at the last record, e.g. `q/p = 0.52`.
        before: These values one record before; empty at the first record.
        over: True if the path is over too.
    """

    step: int
    cause: Cause
    what: str = ""
    reached: str = ""
    before: str = ""
    over: bool = True

    @property
    def reason(self) -> str:
        """Why the path ended before its aim; empty if it reached its aim, or a condition of the user."""
        return self.what if self.cause in (Cause.LIMIT, Cause.LOST) else ""

    @property
    def missed(self) -> bool:
        """True if the step had a condition that was not met before its strain or stress was reached."""
        return self.cause in (Cause.STRAIN, Cause.STRESS) and bool(self.what)

    @property
    def clause(self) -> str:
        """What to say of a condition that was met or missed, or of a signal; empty for any other ending."""
        if self.cause is Cause.SIGNAL:
            return f"stopped by {self.what}"
        if self.missed:
            return f"{self.what} was never met in step {self.step}"
        if self.cause not in (Cause.CONDITION, Cause.STOP_WHEN):
            return ""
        who = "it" if self.cause is Cause.STOP_WHEN else f"step {self.step}"
        before = f"; {self.before} one record before" if self.before else ""
        return f"{who} ended when {self.what} ({self.reached}{before})"


@dataclasses.dataclass(frozen=True)
class Endings:
    """The endings of a run so far.

    Args:
        met: Number of steps that a condition ended.
        last: The last endings of steps with a condition, at most five, and the ending of the path.
        missed: Number of steps whose condition was never met.
    """

    met: int = 0
    last: tuple[Ending, ...] = ()
    missed: int = 0

    def after(self, ending: Ending | None) -> Endings:
        """Return the endings after a record, at which a step may have ended. A signal is forgotten at the next one."""
        last = tuple(ending for ending in self.last if ending.cause is not Cause.SIGNAL)
        if ending is None or not (ending.over or ending.missed or ending.cause is Cause.CONDITION):
            return Endings(self.met, last, self.missed)
        met, missed = self.met + (ending.cause is Cause.CONDITION), self.missed + ending.missed
        return Endings(met, (*last, ending)[-MOST_STORED:], missed)

    @property
    def reason(self) -> str:
        """Why the run ended before its aim; empty if it did not."""
        return self.last[-1].reason if self.last else ""

    def words(self, stop_when: str | None = None) -> tuple[str, ...]:
        """Say which conditions were met or missed, one clause each; their number if more than five steps had any.

        Args:
            stop_when: The condition that was to end the run, if the run is over.
        """
        met = [ending.clause for ending in self.last if ending.cause is Cause.CONDITION]
        missed = [ending.clause for ending in self.last if ending.missed]
        others = [ending.clause for ending in self.last if ending.cause in (Cause.SIGNAL, Cause.STOP_WHEN)]
        if self.met > len(met) and met:
            met = [f"{self.met} steps ended at their conditions, {met[-1]}"]
        if self.missed > len(missed):
            missed = [f"the conditions of {self.missed} steps were never met", *missed[-1:]]
        if stop_when is not None and self.last and self.last[-1].cause is not Cause.STOP_WHEN:
            others.append(f"{stop_when} was never met")
        return (*met, *missed, *others)

    def to_json(self) -> str:
        """Return the endings as JSON, for the attribute `endings` of a run file."""
        last = [dataclasses.asdict(ending) for ending in self.last]
        return json.dumps({"met": self.met, "last": last, **({"missed": self.missed} if self.missed else {})})


def endings_of(attributes: Values) -> Endings:
    """Return the endings of a run file. A file of labkit 0.2.0.dev0 only says why a run ended before its aim."""
    stored = json.loads(attributes.get("endings", "{}"))
    last = [Ending(**{**values, "cause": Cause(values["cause"])}) for values in stored.get("last", ())]
    reason = str(attributes.get("ended_because", ""))
    if reason and "endings" not in attributes:
        last = [Ending(0, Cause.LIMIT if attributes["complete"] else Cause.LOST, reason)]
    return Endings(stored.get("met", 0), tuple(last), stored.get("missed", 0))

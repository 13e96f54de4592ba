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
        what: The condition or the stress, or a sentence that states the reason.
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
    def clause(self) -> str:
        """What to say of a condition that was met, or of a signal; empty for any other ending."""
        if self.cause is Cause.SIGNAL:
            return f"stopped by {self.what}"
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
        last: The last endings by a condition, at most five, and the ending of the path.
    """

    met: int = 0
    last: tuple[Ending, ...] = ()

    def after(self, ending: Ending | None) -> Endings:
        """Return the endings after a record, at which a step may have ended. A signal is forgotten at the next one."""
        last = tuple(ending for ending in self.last if ending.cause is not Cause.SIGNAL)
        if ending is None or not (ending.over or ending.cause is Cause.CONDITION):
            return Endings(self.met, last)
        return Endings(self.met + (ending.cause is Cause.CONDITION), (*last, ending)[-MOST_STORED:])

    @property
    def reason(self) -> str:
        """Why the run ended before its aim; empty if it did not."""
        return self.last[-1].reason if self.last else ""

    @property
    def clauses(self) -> tuple[str, ...]:
        """The conditions that were met, one clause each; a number if more than five steps ended at conditions."""
        steps = [ending.clause for ending in self.last if ending.cause is Cause.CONDITION]
        others = [ending.clause for ending in self.last if ending.cause is not Cause.CONDITION and ending.clause]
        if self.met > len(steps) and steps:
            steps = [f"{self.met} steps ended at their conditions, {steps[-1]}"]
        return (*steps, *others)

    def to_json(self) -> str:
        """Return the endings as JSON, for the attribute `endings` of a run file."""
        return json.dumps({"met": self.met, "last": [dataclasses.asdict(ending) for ending in self.last]})


def endings_of(attributes: Values) -> Endings:
    """Return the endings of a run file. A file of labkit 0.2.0.dev0 only says why a run ended before its aim."""
    stored = json.loads(attributes.get("endings", "{}"))
    last = [Ending(**{**values, "cause": Cause(values["cause"])}) for values in stored.get("last", ())]
    reason = str(attributes.get("ended_because", ""))
    if reason and "endings" not in attributes:
        last = [Ending(0, Cause.LIMIT if attributes["complete"] else Cause.LOST, reason)]
    return Endings(stored.get("met", 0), tuple(last))

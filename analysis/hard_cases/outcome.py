"""Runs a case and determines its verdict.

There are four: `correct` and `limit reported` if every check holds, `clear error` if labkit stopped with a message, and
`SILENT WRONG` if a check fails without any message.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable
from pathlib import Path

from analysis.hard_cases.cases import CASES
from analysis.hard_cases.checks import Check, true
from analysis.hard_cases.laboratory import Laboratory
from analysis.hard_cases.measures import MEASURED, common_checks, measure
from analysis.hard_cases.scenes import CLEAR_ERROR, LIMIT_REPORTED, SILENT_WRONG, HardScene
from labkit.errors import PhysicsError

CRASH = "YADE ended with exit status"  # a crash is not a clear error: the study stops


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Outcome of a case on an engine. The errors are None if the case left no run to measure."""

    case: str
    engine: str
    should: str
    did: str
    verdict: str
    failed: str  # checks that fail
    checks: int  # number of checks
    guard: str  # messages of labkit
    energy_balance_error: float | None  # largest over all records, relative to the work
    stress_error: float | None  # stored against recomputed stresses, relative
    held_error: float | None  # largest error of a held quantity: stress, relative volume, or difference of strains
    c0_error: float | None  # largest difference of C0 and Love's stress while p > 50 kPa
    momentum: float | None  # |sum m c|/sum m |c| at the end, c relative to the mean field
    undamped_momentum: float | None  # change of sum m c without local damping, on the `fused` engine
    grains: int
    seconds: float


def examine(
    scene: HardScene, engine: str, grains: int, extent: float, folder: str | Path, shared: str | Path
) -> Outcome:
    """Examines a scene on an engine. `grains`: number of grains of the specimen, unless the scene prescribes it."""
    lab = Laboratory(scene, engine, grains, extent, folder, shared)
    start, error, did = time.monotonic(), "", ""
    checks: list[Check] = []
    try:
        did, checks = CASES[scene.name](lab)
    except PhysicsError as stopped:
        error = str(stopped)
        if CRASH in error:
            raise
        lab.messages.append(error)
    measured = [] if error else [measure(file) for file in lab.runs]
    if not error:
        checks = [*checks, *(check for values in measured for check in common_checks(values, scene.judges_c0))]
        if scene.verdict == LIMIT_REPORTED:
            checks.append(true("an exceeded limit is reported", bool(lab.messages)))
    failed = [str(check) for check in checks if not check.holds]
    if error:
        verdict = CLEAR_ERROR
    else:
        verdict = SILENT_WRONG if failed else scene.verdict
    return Outcome(
        case=scene.name,
        engine=engine,
        should=scene.should,
        did=error or did,
        verdict=verdict,
        failed="; ".join(failed),
        checks=len(checks),
        guard=" | ".join(dict.fromkeys(lab.messages)),
        **{name: _largest(values[name] for values in measured) for name in MEASURED},
        grains=grains,
        seconds=time.monotonic() - start,
    )


def _largest(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return max(known) if known else None

"""Runs a case and gives its verdict.

A case ends with one of four: `correct` and `limit said` if every check holds, `clear error` if labkit gave up with a
sentence, `SILENT WRONG` if a check fails that no sentence spoke of.
"""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

from analysis.hard_cases.cases import CASES
from analysis.hard_cases.checks import true
from analysis.hard_cases.laboratory import Laboratory
from analysis.hard_cases.measures import MEASURED, common_checks, measure
from analysis.hard_cases.scenes import CLEAR_ERROR, LIMIT_SAID, SILENT_WRONG, HardScene
from labkit.errors import PhysicsError

CRASH = "YADE ended with exit status"  # which is no clear error: the study ends with it


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a case on an engine. Errors are None where the case left no run to measure."""

    case: str
    engine: str
    should: str
    did: str
    verdict: str
    failed: str  # the checks that do not hold
    checks: int  # how many were made
    guard: str  # what labkit said
    energy_balance_error: float | None  # worst of all records, over the work
    stress_error: float | None  # stored against recomputed stresses, relative
    held_error: float | None  # worst of what the path holds: stress, relative volume, or difference of strains
    c0_error: float | None  # worst C0 against Love with p > 50 kPa
    momentum: float | None  # |sum m c|/sum m |c| at the end, c without the mean field
    undamped_momentum: float | None  # its change while the run goes on without local damping, in the engine fused
    grains: int
    seconds: float


def examine(
    scene: HardScene, engine: str, grains: int, extent: float, folder: str | Path, shared: str | Path
) -> Outcome:
    """The Outcome of a scene on an engine. `grains`: of its specimen, unless the scene is about their number."""
    lab = Laboratory(scene, engine, grains, extent, folder, shared)
    begun, error, did, checks = time.monotonic(), "", "", []
    try:
        did, checks = CASES[scene.name](lab)
    except PhysicsError as given_up:
        error = str(given_up)
        if CRASH in error:
            raise
        lab.said.append(error)
    measured = [] if error else [measure(file) for file in lab.runs]
    if not error:
        checks = [*checks, *(check for found in measured for check in common_checks(found, scene.judges_c0))]
        if scene.verdict == LIMIT_SAID:
            checks.append(true("it says what limit it left", bool(lab.said)))
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
        guard=" | ".join(dict.fromkeys(lab.said)),
        **{name: _worst(found[name] for found in measured) for name in MEASURED},
        grains=grains,
        seconds=time.monotonic() - begun,
    )


def _worst(values):
    known = [value for value in values if value is not None]
    return max(known) if known else None

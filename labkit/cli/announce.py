"""The line that a command prints before a simulation: engine, grains, steps and expected time."""

from __future__ import annotations

import sys

from labkit.engines.base import Progress
from labkit.io.netcdf import labkit_kind, open_netcdf
from labkit.io.progress import reporter
from labkit.records.limits import size_warning
from labkit.runs.tasks import RunTask, Task


def announcing(task: Task[object], title: str) -> Progress:
    """Return a progress function that first prints one line to standard error: engine, grains, steps, expected time.

    It prints with the first progress report, so that an input error, found before that, appears without it.
    """
    from labkit.campaigns.cost import announcement

    steps_done = _steps_done(str(task.output)) if isinstance(task, RunTask) else 0
    reporters: list[Progress] = []

    def progress(fraction: float, text: str) -> None:
        if not reporters:
            print(f"{title}: {announcement(task, steps_done)}", file=sys.stderr, flush=True)
            warning = task.warning if isinstance(task, RunTask) else size_warning(task.scene)
            if warning:
                print(f"{title}: {warning}", file=sys.stderr, flush=True)
            reporters.append(reporter(title))
        reporters[0](fraction, text)

    return progress


def _steps_done(file: str) -> int:
    """Number of steps stored in a run file; 0 if the file does not exist."""
    if labkit_kind(file) != "run":
        return 0
    with open_netcdf(file, "run", verify=False) as dataset:
        return int(getattr(dataset, "steps", 0))

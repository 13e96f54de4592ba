"""One job of a workflow: `python -m labkit.cli.job KIND [NAME]`, in the folder of a campaign.

A specimen, a consolidation or a run is the command of its recipe into the file for unfinished work, which is moved to
its place when it is finished. So an engine that removes the outputs of a broken job does not lose a checkpoint. What it
says goes to its log. The other kinds are `statistics` and `figure` of a run, and `report`.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable
from pathlib import Path

from labkit.campaign.own_files import read_copy
from labkit.campaign.plan import FIGURES, RUNS, Job, Plan, plan_of
from labkit.cli.dispatch import main as run_command
from labkit.engines import die_with_parent
from labkit.errors import InputError, PhysicsError, exit_code, fail, sentence


def main(kind: str, *name: str) -> int:
    """Does the job; returns the exit code of its command."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    die_with_parent()  # a workflow that is killed leaves nobody who writes its files
    plan = plan_of(read_copy())
    products: dict[str, Callable[..., None]] = {"statistics": statistics, "figure": figure, "report": report}
    if kind not in products:
        return simulate(next(job for job in plan.jobs if (job.kind, job.name) == (kind, *name)))
    try:
        products[kind](plan, *name)
    except (InputError, PhysicsError) as error:
        return fail(sentence(error), exit_code(error))
    return 0


def simulate(job: Job) -> int:
    """Runs the command of a job with its log; returns its exit code."""
    with open(job.log, "w") as log, contextlib.redirect_stdout(log), contextlib.redirect_stderr(log):
        code = _to_its_place(job)
    if code:
        last = Path(job.log).read_text().strip().splitlines()[-1:] or ["it said nothing"]
        print(f"{job.kind} {job.name}: {last[0]}", file=sys.stderr)
    return code


def _to_its_place(job: Job) -> int:
    try:
        code = run_command(job.command)
    except Exception as error:  # the log tells the rest
        fail(f"{type(error).__name__}: {error}", 1)
        raise
    if code == 0:
        os.replace(job.unfinished, job.output)
        for other in Path(job.unfinished).parent.glob(f"{job.name}.{'?' * 12}.{job.ending}"):
            other.unlink()  # of earlier parameters
    return code


def statistics(plan: Plan, name: str) -> None:
    """Writes the numbers of a run."""
    from labkit.campaign import products

    products.write_statistics(name)


def figure(plan: Plan, name: str) -> None:
    """Draws Love's stress and C0 along a run."""
    from labkit.runs.dataset import open_run
    from labkit.visuals import plots

    file = Path(RUNS) / f"{name}.run.nc"
    plots.save(plots.sff_against_love({name: open_run(file)}), Path(FIGURES) / f"{name}.png", [file])


def report(plan: Plan) -> None:
    """Writes the page of the campaign."""
    from labkit.campaign import products

    products.write_report(plan)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

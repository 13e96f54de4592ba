"""One job of a workflow: `python -P -m labkit.cli.job KIND [NAME]`, in the folder of a campaign.

For a specimen, a consolidation or a run, the job runs the command of its recipe. It writes to a temporary file that is
moved into place when finished, so a workflow engine that removes the outputs of a failed job does not delete its
checkpoint. Its output goes to its log. The other kinds are `statistics` and `figure` of a run, and `report`.
"""

from __future__ import annotations

import contextlib
import os
import sys
from glob import glob
from os.path import exists
from pathlib import Path

from labkit.campaigns.file import read_copy
from labkit.campaigns.items import PlannedRun
from labkit.campaigns.plan import OVERVIEW, PLOTS, RUNS, STATISTICS, Job, Plan, leave_the_future, plan_of
from labkit.campaigns.workflow import PROCESS
from labkit.cli.dispatch import main as run_command
from labkit.errors import InputError, Interrupted, PhysicsError, exit_code, fail, sentence
from labkit.io.atomic import open_log, require_no_link
from labkit.io.interruption import die_with_parent


def run_job(kind: str, name: str = "") -> int:
    """Carry out the job; returns the exit code of its command."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    die_with_parent()  # if the workflow is killed, no job continues to write files
    if not campaign_lives():  # the campaign was killed while this job was starting
        return fail("the campaign was killed", 1)
    plan = plan_of(read_copy())
    inputs = [f"{RUNS}/{name}.run.nc"]
    try:
        match kind:
            case "statistics":
                from labkit.campaigns.products import write_statistics

                write_statistics(name)
            case "figure":
                from labkit.figures import plots
                from labkit.runs.read.run import Run

                plots.save(Run.open(inputs[0]).plot(), f"{PLOTS}/{name}.png", inputs)
            case "report":
                report(plan)
                inputs = [*glob(f"{STATISTICS}/*.nc"), *glob(f"{PLOTS}/*.png")]
            case _:
                return simulate(next(job for job in plan.jobs if (job.kind, job.name) == (kind, name)))
    except (InputError, PhysicsError, Interrupted) as error:
        return fail(sentence(error), exit_code(error))
    leave_the_future(inputs)
    return 0


def campaign_lives() -> bool:
    """True unless this job belongs to a campaign on this computer that has ended."""
    number = os.environ.get(PROCESS)
    return number is None or exists(f"/proc/{number}") or not exists("/proc")


def simulate(job: Job) -> int:
    """Run the command of a job, with its output in the log; returns its exit code."""
    with open_log(job.log) as log, contextlib.redirect_stdout(log), contextlib.redirect_stderr(log):
        code = _run_and_move(job)
    if code:
        last = Path(job.log).read_text().strip().splitlines()[-1:] or ["no output"]
        print(f"{job.kind} {job.name}: {last[0]}", file=sys.stderr)
    return code


def _run_and_move(job: Job) -> int:
    """Run the command of a job and move its output into place; returns its exit code."""
    require_no_link(job.unfinished)
    try:
        code = run_command(job.command)
    except Exception as error:  # the traceback follows in the log
        fail(f"{type(error).__name__}: {error}", 1)
        raise
    if code == 0:
        leave_the_future(job.inputs)
        os.replace(job.unfinished, job.output)
        for other in Path(job.unfinished).parent.glob(f"{job.name}.{'?' * 12}.{job.ending}"):
            other.unlink()  # written with earlier parameters
    return code


def report(plan: Plan) -> None:
    """Draw the overview of all finished runs and write the report."""
    from labkit.campaigns.report import write_report
    from labkit.figures import plots
    from labkit.figures.campaign_figure import overview

    finished = [
        (item, job.output) for job in plan.runs if isinstance(item := job.item, PlannedRun) and exists(job.output)
    ]
    if finished:
        plots.save(overview(finished), OVERVIEW, [file for _, file in finished])
    write_report(plan)


if __name__ == "__main__":
    sys.exit(run_job(*sys.argv[1:]))

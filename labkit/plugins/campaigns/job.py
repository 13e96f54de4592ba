"""One job of a workflow: `python -P -m labkit.plugins.campaigns.job KIND [NAME]`, in the folder of a campaign.

A specimen, a consolidation or a run is defined by its recipe alone. The job writes to a temporary file that is moved
into place when finished, so a workflow engine that removes the outputs of a failed job does not delete its checkpoint.
Messages go to the log of the job. The other kinds are `statistics` and `figure` of a run, and `report`.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from glob import glob
from os.path import exists
from pathlib import Path
from typing import TYPE_CHECKING

from labkit import extensions
from labkit.cli import program
from labkit.cli.dispatch import report_errors
from labkit.errors import InputError, fail
from labkit.files.atomic import open_log, require_no_link
from labkit.plugins.campaigns import layout
from labkit.process.children import die_with_parent
from labkit.text.foreign import content_of, noting_files

if TYPE_CHECKING:
    from labkit.plugins.campaigns.jobs import Job


def run_job(kind: str, name: str = "") -> int:
    """Carry out the job; returns its exit code."""
    die_with_parent()  # if the workflow is killed, no job continues to write files
    if not campaign_lives():  # the campaign was killed while this job was starting
        return fail("the campaign was killed", 1)
    make = make_product if kind in ("statistics", "figure", "report") else execute_into_log
    return report_errors(lambda: make(layout.Row(kind, name)))


def campaign_lives() -> bool:
    """Return True unless this job belongs to a campaign on this computer that has ended."""
    number = os.environ.get(layout.PROCESS)
    return number is None or exists(f"/proc/{number}") or not exists("/proc")


def read_job(row: layout.Row) -> Job:
    """Read a job from its recipe, and load the user's files that it needs. Raises InputError if that fails.

    These files are executed, so the campaign file must name them too.
    """
    from labkit.plugins.campaigns.file import named_files
    from labkit.plugins.campaigns.jobs import Job

    file = Path(layout.recipe_of(row))
    os.environ[extensions.VARIABLE] = ""
    try:
        values = json.loads(content_of(file))
        if values["use"] and not named_files() >= set(values["use"]):
            raise InputError(f"{file} uses files that {layout.CAMPAIGN} does not name: repeat labkit campaign")
        for used in values["use"]:
            extensions.use(used)
        return Job.from_values(values)
    except InputError:
        raise
    except (OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError):
        raise InputError(f"{file} cannot be read: repeat labkit campaign, which writes it") from None


def execute_into_log(row: layout.Row) -> int:
    """Execute a job, with its output in its log; returns its exit code."""
    with open_log(layout.log_of(row)) as log, contextlib.redirect_stdout(log), contextlib.redirect_stderr(log):
        try:
            code = report_errors(lambda: execute_job(row))
        except Exception as error:  # the traceback is written to the log
            fail(f"{type(error).__name__}: {error}", 1)
            raise
    if code:
        last = Path(layout.log_of(row)).read_text().strip().splitlines()[-1:] or ["no output"]
        print(f"{row.kind} {row.name}: {last[0]}", file=sys.stderr)
    return code


def execute_job(row: layout.Row) -> int:
    """Execute a job and move its output into place; returns 0."""
    from labkit.simulation.reports import execute_and_report

    job = read_job(row)
    output = layout.unfinished_of(row, job.digest)
    require_no_link(output)
    with noting_files(job.files):
        execute_and_report(job.task(output))
    layout.leave_the_future([layout.recipe_of(row), *filter(None, [job.source])])
    os.replace(output, layout.output_of(row))
    for other in glob(layout.unfinished_of(row, "?" * 12)):
        os.unlink(other)  # a result of earlier parameters
    return 0


def make_product(row: layout.Row) -> int:
    """Make the statistics or the figure of a run, or the report; returns 0."""
    run = layout.Row("run", row.name)
    inputs = [layout.output_of(run)]
    if row.kind == "report":
        inputs = [*glob(f"{layout.STATISTICS}/*.nc"), *glob(f"{layout.PLOTS}/*.png")]
        report()
    elif row.kind == "statistics":
        read_job(run)
        from labkit.plugins.campaigns.products import write_statistics

        write_statistics(row.name)
    else:
        read_job(run)
        from labkit.figures import plots
        from labkit.results.run import Run

        plots.save(Run.open(inputs[0]).plot(), f"{layout.PLOTS}/{row.name}.png", inputs)
    layout.leave_the_future(inputs)
    return 0


def report() -> None:
    """Draw the overview of all finished runs and write the report."""
    from labkit.figures import plots
    from labkit.plugins.campaigns.figure import overview
    from labkit.plugins.campaigns.report import write_report

    rows = layout.read_plan()
    files = {row: file for row in rows if row.kind == "run" and exists(file := layout.output_of(row))}
    runs = list(map(read_job, files))
    if runs:
        plots.save(overview(list(zip(runs, files.values(), strict=True))), layout.OVERVIEW, list(files.values()))
    write_report(rows, runs)


if __name__ == "__main__":
    sys.exit(program(lambda: run_job(*sys.argv[1:])))

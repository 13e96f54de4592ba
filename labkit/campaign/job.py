"""One job of a workflow: `python -m labkit.campaign.job KIND NAME`, in the folder of a campaign.

Runs the command of the job's recipe into the file for unfinished work and moves it to its place when it is finished.
So an engine that removes the outputs of a broken job does not lose a checkpoint. What it says goes to its log.
"""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

from labkit import cli
from labkit.campaign.file import read_campaign
from labkit.campaign.plan import CAMPAIGN, plan_of
from labkit.engines.yade_process import die_with_parent
from labkit.errors import fail


def main(kind, name):
    """Does the job; returns the exit code of its command."""
    die_with_parent()  # a workflow that is killed leaves nobody who writes its files
    plan = plan_of(read_campaign(CAMPAIGN))
    job = next(job for job in plan.jobs if (job.kind, job.name) == (kind, name))
    with open(job.log, "w") as log, contextlib.redirect_stdout(log), contextlib.redirect_stderr(log):
        code = work(job)
    if code:
        last = Path(job.log).read_text().strip().splitlines()[-1:] or ["it said nothing"]
        print(f"{kind} {name}: {last[0]}", file=sys.stderr)
    return code


def work(job):
    try:
        code = cli.main(job.command)
    except Exception as error:  # the log tells the rest
        fail(f"{type(error).__name__}: {error}", 1)
        raise
    if code == 0:
        os.replace(job.unfinished, job.output)
        for other in Path(job.unfinished).parent.glob(f"{job.name}.{'?' * 12}.{job.ending}"):
            other.unlink()  # of earlier parameters
    return code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

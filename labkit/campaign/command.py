"""`labkit campaign FILE`: validates, estimates, runs."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from labkit.cli import arguments
from labkit.campaign import cost, tables, workflow
from labkit.campaign.file import read_campaign
from labkit.campaign.plan import REPORT, plan_of
from labkit.engines.yade_process import find_yade
from labkit.errors import InputError
from labkit.io.files import require_writable
from labkit.io.progress import reporter

OURS = ("quick",)  # campaigns that come with labkit


def ours(name):
    """The file of a campaign that comes with labkit."""
    return Path(__file__).resolve().parent / f"{name}.yaml"


def add_campaign_options(parser):
    parser.add_argument("file", nargs="?", help="campaign file, or `quick`, which comes with labkit")
    parser.add_argument("--folder", help="where the results go (default: the campaign's name, here)")
    parser.add_argument("--cores", type=arguments.positive_int, default=os.cpu_count() or 1, help="of this machine, to "
                        "be filled with jobs (default: all)")  # fmt: skip
    parser.add_argument("--profile", help="slurm, or the folder of a profile of Snakemake: where the jobs run "
                        "(default: here)")  # fmt: skip
    parser.add_argument("--dry-run", action="store_true", help="only say what would run, how long, and how large")
    parser.add_argument("--measure", action="store_true", help="measure the speed of this machine again first")
    parser.add_argument("--tables", metavar="FOLDER", help="only write the tables for yade-batch there")
    parser.add_argument("--snakefile", action="store_true", help="only say where the Snakefile is")


def campaign(options):
    """Carries out the command; returns 0, or 1 when something failed. Raises InputError."""
    if options.snakefile:
        print(workflow.SNAKEFILE)
        return 0
    if options.file is None:
        raise InputError("FILE is missing: give a campaign file, or `quick`, which comes with labkit")
    file = ours(options.file) if options.file in OURS else Path(options.file)
    found = read_campaign(file)
    plan = plan_of(found)
    engines = sorted({job.item.engine for job in plan.jobs})
    if options.tables:
        for written in tables.write_tables(plan, Path(options.tables)):
            print(written)
        return 0
    if "yade" in engines and options.profile is None:
        find_yade()
    folder = Path(options.folder or found.name)
    require_writable(folder.parent / "campaign" if not folder.exists() else folder / "campaign.tmp")
    if not options.dry_run:
        workflow.require_snakemake(options.profile)
    speeds = None if options.measure else cost.known_speeds(engines)
    if speeds is None and (options.dry_run or options.measure):
        speeds = cost.measure_speeds(engines, reporter("measuring"))
    if options.dry_run:
        print(cost.summary(plan, speeds, options.cores, True))
        return 0
    text = file.read_text(encoding="utf-8")
    code = workflow.run_workflow(plan, text, folder, options.cores, options.profile, reporter(found.name))
    return tell(plan, folder, code)


def tell(plan, folder, code):
    """Says how the campaign stands; the exit code."""
    failed, waiting = workflow.failures(plan, folder)
    for kind, name, reason in failed:
        print(f"labkit: {kind} {name} failed: {reason}", file=sys.stderr)
    if waiting:
        print(f"labkit: not begun{' because of these' * bool(failed)}: {', '.join(waiting)}", file=sys.stderr)
    there = sum((folder / job.output).exists() for job in plan.runs)
    print(f"{folder}: {there} of {len(plan.runs)} runs are finished; see {folder / REPORT}")
    if code and not failed:
        print(f"labkit: Snakemake ended with exit status {code}: see {folder / workflow.LOG}", file=sys.stderr)
    return 1 if failed or code else 0

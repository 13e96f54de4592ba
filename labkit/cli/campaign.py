"""`labkit campaign FILE`: validates a campaign, estimates its cost and carries it out."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from labkit.cli.arguments import positive_int, require
from labkit.cli.registry import command
from labkit.io.files import require_writable
from labkit.io.progress import reporter

if TYPE_CHECKING:
    from labkit.campaign.plan import Plan


def campaign_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit campaign`."""
    parser.add_argument(
        "file", metavar="FILE", nargs="?", help="campaign file (YAML), or `quick`, an example that comes with labkit"
    )
    parser.add_argument(
        "--folder",
        help="folder for the results (default: a folder in the current directory, named after the campaign)",
    )
    parser.add_argument(
        "--cores",
        type=positive_int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="number of cores to use for jobs (default: all)",
    )
    parser.add_argument(
        "--profile", help="where the jobs run: slurm, or a Snakemake profile folder (default: this computer)"
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="only print what would run, how long it would take and how much disk space it needs",
    )
    parser.add_argument(
        "--measure", action="store_true", help="measure the speed of this computer again, for the estimate"
    )
    parser.add_argument("--tables", metavar="FOLDER", help="only write the tables for yade-batch to this folder")
    parser.add_argument(
        "--crate", action="store_true", help="only describe the finished campaign as an RO-Crate, for an archive"
    )
    parser.add_argument(
        "--snakefile", action="store_true", help="only print the path of the Snakefile, for use with snakemake itself"
    )


@command("campaign", campaign_options)
def do_campaign(options: argparse.Namespace, argv: list[str]) -> int:
    """Returns 1 if a job failed."""
    from labkit.campaign import cost, crate, speeds, tables, workflow
    from labkit.campaign.file import campaign_file, read_campaign
    from labkit.campaign.plan import plan_of

    if options.snakefile:
        print(workflow.SNAKEFILE)
        return 0
    require(options.file, "file", "a campaign file, or `quick`, which comes with labkit")
    file = campaign_file(options.file)
    campaign = read_campaign(file)
    plan = plan_of(campaign)
    if options.tables:
        print(*tables.write_tables(plan, Path(options.tables)), sep="\n")
        return 0
    folder = Path(options.folder or campaign.name)
    if options.crate:
        print(f"crate: {crate.write_crate(folder)}")
        return 0
    require_possible(plan, folder, options)
    if options.dry_run or options.measure:
        known = None if options.measure else speeds.known_speeds(plan.engines)
        measured = known or speeds.measure_speeds(plan.engines, reporter("measuring"))
        if options.dry_run:
            print(cost.summary(plan, measured, options.cores))
            return 0
    text = file.read_text(encoding="utf-8")
    code = workflow.run_workflow(plan, text, folder, options.cores, options.profile, reporter(campaign.name))
    return workflow.tell(plan, folder, code)


def require_possible(plan: Plan, folder: Path, options: argparse.Namespace) -> None:
    """Raises InputError if this computer lacks something that the plan needs, or if the folder cannot be written."""
    from labkit.campaign import workflow
    from labkit.campaign.batches import batched
    from labkit.engines import ENGINES, find_yade
    from labkit.errors import InputError

    if "yade" in plan.engines and options.profile is None:
        find_yade()
    if options.profile is None:
        for engine in plan.engines:
            ENGINES[engine].require_here()
    elif any(map(batched, plan.runs)) and plan.campaign.gpu_memory is None:
        raise InputError("gpu_memory is missing in the campaign file: give that of a GPU of the cluster, e.g. 80 GB")
    require_writable(folder / "campaign.tmp" if folder.exists() else folder.parent / "campaign")
    if not options.dry_run:
        workflow.require_snakemake(options.profile)

"""`labkit campaign FILE`: validates, estimates, runs."""

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
    """Options of a campaign."""
    parser.add_argument("file", nargs="?", help="campaign file, or `quick`, which comes with labkit")
    parser.add_argument("--folder", help="where the results go (default: the campaign's name, here)")
    parser.add_argument(
        "--cores",
        type=positive_int,
        default=os.cpu_count() or 1,
        help="of this computer, to be filled with jobs (default: all)",
    )
    parser.add_argument(
        "--profile", help="slurm, or the folder of a profile of Snakemake: where the jobs run (default: here)"
    )
    parser.add_argument("--dry-run", action="store_true", help="only say what would run, how long, and how large")
    parser.add_argument("--measure", action="store_true", help="measure the speed of this computer again first")
    parser.add_argument("--tables", metavar="FOLDER", help="only write the tables for yade-batch there")
    parser.add_argument("--snakefile", action="store_true", help="only say where the Snakefile is")


@command("campaign", campaign_options)
def do_campaign(options: argparse.Namespace, argv: list[str]) -> int:
    """Returns 1 when something failed."""
    from labkit.campaign import cost, tables, workflow
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
    require_possible(plan, folder, options)
    if options.dry_run or options.measure:
        known = None if options.measure else cost.known_speeds(plan.engines)
        speeds = known or cost.measure_speeds(plan.engines, reporter("measuring"))
        if options.dry_run:
            print(cost.summary(plan, speeds, options.cores))
            return 0
    text = file.read_text(encoding="utf-8")
    code = workflow.run_workflow(plan, text, folder, options.cores, options.profile, reporter(campaign.name))
    return workflow.tell(plan, folder, code)


def require_possible(plan: Plan, folder: Path, options: argparse.Namespace) -> None:
    """Raises InputError unless this computer has what the plan needs, and the folder can be written."""
    from labkit.campaign import workflow
    from labkit.engines import find_yade

    if "yade" in plan.engines and options.profile is None:
        find_yade()
    require_writable(folder / "campaign.tmp" if folder.exists() else folder.parent / "campaign")
    if not options.dry_run:
        workflow.require_snakemake(options.profile)

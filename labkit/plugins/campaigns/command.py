"""`labkit campaign FILE`: validates a campaign, estimates its cost and carries it out."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from labkit.cli.arguments import Made, Option, require
from labkit.cli.registry import command
from labkit.files.atomic import require_no_link
from labkit.files.writable import require_writable
from labkit.process.progress import reporter


@dataclasses.dataclass(frozen=True, kw_only=True)
class Modes:
    """Actions of the command in addition to carrying out the campaign, or instead."""

    dry_run: Annotated[
        bool, Option("only print what would run, how long it would take and how much disk space it needs")
    ] = False
    snakefile: Annotated[bool, Option("only print the path of the Snakefile, for use with snakemake itself")] = False


@command("campaign")
def campaign_command(
    file: Annotated[str | None, Option("campaign file (YAML), or `quick`, an example that comes with labkit")] = None,
    *,
    folder: Annotated[
        str | None,
        Option("folder for the results (default: a folder in the current directory, named after the campaign)"),
    ] = None,
    cores: Annotated[int, Option("number of cores to use for jobs (default: all)")] = os.cpu_count() or 1,
    profile: Annotated[
        str | None, Option("where the jobs run: slurm, or a Snakemake profile folder (default: this computer)")
    ] = None,
    modes: Annotated[Modes, Made(Modes)],
) -> int:
    """Carries out the specimens and runs defined in one file with Snakemake, here or on a SLURM cluster.

    Writes a folder with all results and report.md. Repeat the same command to resume, or after a change of the file.
    Exit code 1 if a job failed.

    Examples:
        labkit campaign quick --dry-run
        labkit campaign mine.yaml --cores 4
        labkit campaign mine.yaml --profile slurm
    """
    from labkit.plugins.campaigns import cost, workflow
    from labkit.plugins.campaigns.file import campaign_file, read_campaign
    from labkit.plugins.campaigns.plan import unfinished_jobs

    if modes.snakefile:
        print(workflow.SNAKEFILE)
        return 0
    source = campaign_file(require(file, "file", "a campaign file, or `quick`, which comes with labkit"))
    campaign = read_campaign(source)
    results = Path(folder or campaign.name)
    if folder is None:
        require_no_link(results)
    require_resources(campaign.engines, results, profile, modes.dry_run)
    if modes.dry_run:
        print(cost.cost_table(campaign.jobs, unfinished_jobs(campaign, results), cores))
        return 0
    print(*(f"{line}\n" for line in cost.rate_warnings(unfinished_jobs(campaign, results))), sep="", end="")
    text = source.read_text(encoding="utf-8")
    code = workflow.run_workflow(campaign, text, results, cores, profile, reporter(campaign.name))
    return workflow.tell(results, code)


def require_resources(engines: Sequence[str], folder: Path, profile: str | None, dry_run: bool) -> None:
    """Raise InputError if this computer lacks something that the engines need, or if the folder cannot be written."""
    from labkit.engines import ENGINES, find_yade
    from labkit.plugins.campaigns import workflow

    if "yade" in engines and profile is None:
        find_yade()
    if profile is None:
        for engine in engines:
            ENGINES[engine].abilities.require_computer()
    require_writable(folder / "campaign.tmp" if folder.exists() else folder.parent / "campaign")
    if not dry_run:
        workflow.require_snakemake(profile)

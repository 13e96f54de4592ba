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
    measure: Annotated[bool, Option("measure the speed of this computer again, for the estimate")] = False
    tables: Annotated[str | None, Option("only write the tables for yade-batch to this folder", "FOLDER")] = None
    crate: Annotated[bool, Option("only describe the finished campaign as an RO-Crate, for an archive")] = False
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
        labkit campaign mine.yaml --crate         # after it: ro-crate-metadata.json, for an archive
    """
    from labkit.plugins.campaigns import cost, speeds, workflow
    from labkit.plugins.campaigns.crate import write_crate
    from labkit.plugins.campaigns.file import campaign_file, read_campaign
    from labkit.plugins.campaigns.plan import unfinished_jobs
    from labkit.plugins.campaigns.tables import write_tables
    from labkit.simulation.cost import TYPICAL

    if modes.snakefile:
        print(workflow.SNAKEFILE)
        return 0
    source = campaign_file(require(file, "file", "a campaign file, or `quick`, which comes with labkit"))
    campaign = read_campaign(source)
    if modes.tables:
        print(*write_tables(campaign, Path(modes.tables)), sep="\n")
        return 0
    results = Path(folder or campaign.name)
    if folder is None:
        require_no_link(results)
    if modes.crate:
        print(f"crate: {write_crate(results)}")
        return 0
    require_resources(campaign.engines, results, profile, modes.dry_run)
    known, origin = TYPICAL, "typical speeds; --measure measures those of this computer"
    if modes.measure:
        known = speeds.measure_speeds(campaign.engines, reporter("measuring"))
        origin = "speeds measured on this computer"
    if modes.dry_run:
        print(cost.cost_table(campaign.jobs, unfinished_jobs(campaign, results), known, cores, origin))
        return 0
    print(*(f"{line}\n" for line in cost.rate_warnings(unfinished_jobs(campaign, results))), sep="", end="")
    text = source.read_text(encoding="utf-8")
    code = workflow.run_workflow(campaign, text, results, cores, profile, reporter(campaign.name), known)
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

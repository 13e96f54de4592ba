"""The folder of a campaign.

    specimens/    state files, made or consolidated     runs/         run files of finished runs
    unfinished/   state and run files in progress       statistics/   a netCDF file per run
    figures/      a figure per run                      recipes/      a JSON file per job: the job itself
    logs/         the output of each job                report.md     all runs on one page, with provenance
    extensions/   user-supplied files (`use:`)          outdated/     results of earlier parameters
    plan.json     all jobs, with the time and memory that they need

The workflow engine and its jobs read plan.json and the recipes, never the campaign file.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from labkit.errors import InputError
from labkit.files.hashes import file_sha256
from labkit.files.provenance import BESIDE
from labkit.text.foreign import content_of

if TYPE_CHECKING:
    from labkit.plugins.campaigns.jobs import Job

STATES, RUNS, UNFINISHED, STATISTICS, PLOTS = "specimens", "runs", "unfinished", "statistics", "figures"
OUTDATED, EXTENSIONS, RECIPES, LOGS = "outdated", "extensions", "recipes", "logs"
CAMPAIGN, PLAN, REPORT, OVERVIEW = "campaign.yaml", "plan.json", "report.md", "overview.png"
SNAKEMAKE = ".snakemake"  # Snakemake's notes, and places from which it would load plugins
FOLDERS = (STATES, RUNS, UNFINISHED, STATISTICS, PLOTS, RECIPES, LOGS)
OTHERS = (OUTDATED, EXTENSIONS, CAMPAIGN, PLAN, REPORT, f"{REPORT}{BESIDE}", OVERVIEW, SNAKEMAKE)
SETTINGS = (".numba_config.yaml", "matplotlibrc", "ucx.conf")  # libraries read these in a job's working folder
PROCESS = "LABKIT_CAMPAIGN_PROCESS"  # environment variable that tells jobs the process of their campaign
Name = str | os.PathLike[str]


class Row(NamedTuple):
    """A job in plan.json, with the data needed to start it: `memory` in MB, `minutes` the expected time."""

    kind: str
    name: str
    source: str | None = None
    threads: int = 1
    ranks: int = 1
    memory: float = 0.0
    minutes: float = 0.0


def output_of(job: Job | Row) -> str:
    """Return the path of a job's result."""
    return f"{RUNS}/{job.name}.run.nc" if job.kind == "run" else f"{STATES}/{job.name}.state.nc"


def unfinished_of(job: Job | Row, digest: str) -> str:
    """Return the path of the unfinished result of a job; `digest` depends on the parameters of the job."""
    return f"{UNFINISHED}/{job.name}.{digest[:12]}.{'run' if job.kind == 'run' else 'state'}.nc"


def recipe_of(job: Job | Row) -> str:
    """Return the path of a job's recipe."""
    return f"{RECIPES}/{job.kind}.{job.name}.json"


def log_of(job: Job | Row) -> str:
    """Return the path of a job's log."""
    return f"{LOGS}/{job.kind}.{job.name}.log"


def products_of(job: Job | Row) -> list[str]:
    """Return the paths of the statistics and the figure of a run; no paths for other jobs."""
    return [f"{STATISTICS}/{job.name}.nc", f"{PLOTS}/{job.name}.png"] if job.kind == "run" else []


def read_plan(folder: Name = ".", current: bool = False) -> list[Row]:
    """Return the jobs planned in a folder, each after its source. Raises InputError if there is no plan.

    With `current`, also raises InputError if the campaign file, or a file that it uses, has changed since.
    """
    try:
        plan = json.loads(content_of(Path(folder, PLAN)))
        files, rows = plan["files"], [Row(*row) for row in plan["jobs"]]
        if current and (CAMPAIGN not in files or any(file_sha256(Path(folder, name)) != files[name] for name in files)):
            raise ValueError
        if any(os.path.basename(row.name) != row.name for row in rows):  # a name leads to no other folder
            raise ValueError
        return rows
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        problem = f"{Path(folder, PLAN)} does not fit the campaign: repeat labkit campaign, which writes it"
        raise InputError(problem) from None


def require_no_links(folder: Path, others: Iterable[str] = ()) -> None:
    """Raise InputError if one of the files and folders of a campaign, or of `others`, is a symbolic link."""
    places = [os.path.join(folder, name) for name in (*FOLDERS, *OTHERS, *others)]
    links = [place for place in places if os.path.islink(place)]
    while places and not links:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError), os.scandir(places.pop()) as entries:
            for entry in entries:
                links += [entry.path] * entry.is_symlink()
                places += [entry.path] * entry.is_dir(follow_symlinks=False)
    if links:
        raise InputError(f"{links[0]} is a link, and could lead anywhere: delete it, or choose another --folder")


def leave_the_future(files: Sequence[Name], oldest: bool = False) -> None:
    """Reset file times that lie in the future, after a clock was set back, to now or to the time of the oldest file.

    Otherwise Snakemake treats the results made from these files as outdated, deletes them, and never finishes.
    """
    times = dict[Name, int]()
    for file in files:
        with contextlib.suppress(FileNotFoundError):  # another job has moved it
            times[file] = os.stat(file).st_mtime_ns
    now = time.time_ns()
    time_ns = min(now, *times.values()) if oldest else now
    for file in times:
        if times[file] > now:
            os.utime(file, ns=(time_ns, time_ns))

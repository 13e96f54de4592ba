"""Writes the plan of a campaign into its folder: plan.json, and the recipe of each job, which is the job itself.

The recipe of a job whose result stays the same keeps its time, so that tools that compare file times rerun only the
jobs that depend on a change.
"""

from __future__ import annotations

import glob
import json
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from labkit.campaigns.cost import cost_of
from labkit.campaigns.file import Campaign, copied_names
from labkit.campaigns.folder import (
    CAMPAIGN,
    FOLDERS,
    OUTDATED,
    OVERVIEW,
    PLAN,
    RECIPES,
    REPORT,
    SETTINGS,
    UNFINISHED,
    Name,
    Row,
    ending,
    leave_the_future,
    output_of,
    products_of,
    recipe_of,
    require_no_links,
)
from labkit.campaigns.speeds import TYPICAL, Speed
from labkit.errors import InputError
from labkit.io.atomic import write_text, write_texts
from labkit.io.hashes import file_sha256
from labkit.runs.run.jobs import Job, Values


class _Recipe(NamedTuple):
    """A job, its recipe, the earlier recipe if that differs, and True if results of the earlier one are kept."""

    job: Job
    text: str
    earlier: Values | None
    kept: bool


def _recipes(campaign: Campaign, folder: Path) -> Iterator[_Recipe]:
    """Yield the recipes of all jobs."""
    kept: set[str | None] = {None}
    for job in campaign.jobs:
        text, earlier = job.to_json(), None
        found = _bytes_of(folder / recipe_of(job))
        if found != text.encode():
            earlier = _parsed(found)
        if job.source in kept and (earlier is None or _is_same(job, earlier)):
            kept.add(output_of(job))
        yield _Recipe(job, text, earlier, output_of(job) in kept)


def _is_same(job: Job, earlier: Values) -> bool:
    """True if an earlier recipe gives the same result, if its source does.

    Up to version 0.2 a recipe consisted of the command and of the hashes of the user's files.
    """
    if "task" in earlier:
        return bool(earlier.get("digest") == job.digest)
    words = [
        one for one in shlex.split(job.command) if not (job.device.name == "fused" and one.startswith("--threads="))
    ]
    known = (earlier.get("command", [])[:-2], earlier.get("extensions", []))
    return known == (words[:-2], list(job.basis[job.source is not None :]))


def _bytes_of(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError:
        return b""


def _parsed(recipe: bytes) -> Values:
    """Return the JSON of a recipe, empty if it is not one."""
    try:
        known = json.loads(recipe)
    except (ValueError, RecursionError):
        known = None
    return known if isinstance(known, dict) and {"command", "digest"} <= known.keys() else {}


def unfinished_jobs(campaign: Campaign, folder: Path) -> list[Job]:
    """Return the jobs that a campaign would carry out in a folder."""
    waiting: dict[str | None, Job] = {}
    for job, _, _, kept in _recipes(campaign, folder):
        if job.source in waiting or not (kept and (folder / output_of(job)).exists()):
            waiting[output_of(job)] = job
    return list(waiting.values())


def require_campaign_folder(campaign: Campaign, folder: Path, others: Sequence[str] = ()) -> None:
    """Raise InputError if a folder holds files that a campaign would replace or delete but that no campaign wrote.

    Also if it holds links, or settings of libraries, which would act on its jobs. `others` are names of further files
    that the campaign writes there.
    """
    require_no_links(folder, others)
    for name in SETTINGS:
        if (folder / name).exists():
            raise InputError(f"{folder / name} would change what the jobs do: delete it, or choose another --folder")
    recipes = list((folder / RECIPES).glob("*.json"))
    own = {recipe_of(job) for job in campaign.jobs}  # even one that a full disk left empty
    foreign = [file for file in recipes if f"{RECIPES}/{file.name}" not in own and not _parsed(_bytes_of(file))]
    if not recipes:
        within = (file for name in FOLDERS for file in (folder / name).rglob("*") if file.is_file())
        named = (folder / name for name in (REPORT, OVERVIEW, PLAN, *others))
        foreign = [*(file for file in named if file.exists()), *within]
    if foreign:
        raise InputError(f"{foreign[0]} is not from a campaign, and could be replaced: choose another --folder")


def write_plan(campaign: Campaign, folder: Name, speeds: Mapping[str, Speed] = TYPICAL) -> list[str]:
    """Make the folders, write new and changed recipes and the plan, and remove recipes that are no longer planned.

    Returns sentences on the results of earlier recipes. Raises InputError if the folder holds links.
    """
    folder = Path(folder)
    require_no_links(folder)
    for name in FOLDERS:
        (folder / name).mkdir(parents=True, exist_ok=True)
    texts, times, moved = dict[Path, str](), dict[Path, int](), 0
    for job, text, earlier, kept in _recipes(campaign, folder):
        file = folder / recipe_of(job)
        if earlier is None and kept:
            continue
        if kept and earlier:
            times[file] = os.stat(file).st_mtime_ns
            _rename_unfinished(folder, job, earlier["digest"])
        else:
            moved += _set_aside(folder, job)
        texts[file] = text
    write_texts(texts)
    for file, time_ns in times.items():
        os.utime(file, ns=(time_ns, time_ns))
    wanted = {recipe_of(job) for job in campaign.jobs}
    for file in (folder / RECIPES).glob("*.json"):
        if f"{RECIPES}/{file.name}" not in wanted:
            file.unlink()
    _write_rows(campaign, folder, speeds)
    files = [file.path for name in FOLDERS for file in os.scandir(folder / name)]
    leave_the_future(files, min((os.stat(file).st_mtime_ns for file in files if os.path.exists(file)), default=None))
    same = sum((folder / output_of(job)).exists() for job in campaign.jobs if folder / recipe_of(job) in times)
    notes = [f"{same} results of the same jobs, planned differently, are kept"] * bool(same)
    return notes + [f"{moved} results of other parameters are moved to {folder / OUTDATED}"] * bool(moved)


def _write_rows(campaign: Campaign, folder: Path, speeds: Mapping[str, Speed]) -> None:
    """Write plan.json."""
    rows = []
    for job in campaign.jobs:
        cost, device = cost_of(job, speeds), job.device
        ranks = device.threads if device.kind.abilities.parallel == "ranks" else 1
        needs = round(cost.memory, 1), round(cost.seconds / 60.0, 2)
        rows.append(json.dumps(Row(job.kind, job.name, job.source, device.threads, ranks, *needs)))
    names = [name for name in (CAMPAIGN, *copied_names(campaign.use)) if (folder / name).exists()]
    files = json.dumps({name: file_sha256(folder / name) for name in names})
    lines = ",\n".join(rows)
    write_text(folder / PLAN, f'{{"files": {files}, "jobs": [\n{lines}\n]}}\n')


def _rename_unfinished(folder: Path, job: Job, digest: str) -> None:
    """Rename what a job has not finished, whose name contains its digest in an earlier recipe."""
    for file in (folder / UNFINISHED).glob(f"*{glob.escape(job.name)}.{digest[:12]}.{ending(job)}*"):
        file.rename(file.with_name(file.name.replace(digest[:12], job.digest[:12])))


def _set_aside(folder: Path, job: Job) -> bool:
    """Move the results of a job with earlier parameters into the folder OUTDATED; True if there are any."""
    names = [name for name in (output_of(job), *products_of(job)) if (folder / name).exists()]
    for name in names:
        (folder / OUTDATED).mkdir(exist_ok=True)
        (folder / name).replace(folder / OUTDATED / Path(name).name)
    return output_of(job) in names

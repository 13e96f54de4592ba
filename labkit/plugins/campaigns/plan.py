"""Writes the plan of a campaign into its folder: plan.json, and the recipe of each job, which defines it completely.

If the result of a job stays the same, the time of its recipe file does too, so that tools that compare file times rerun
only the jobs that depend on a change.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from labkit.errors import InputError
from labkit.files.atomic import write_text, write_texts
from labkit.files.hashes import file_sha256
from labkit.plugins.campaigns import layout
from labkit.plugins.campaigns.file import Campaign, copied_names
from labkit.plugins.campaigns.jobs import Job, Values
from labkit.text.foreign import content_of


def _recipes(campaign: Campaign, folder: Path) -> Iterator[tuple[Job, str, Values | None, bool]]:
    """Yield each job, its recipe, the earlier recipe if it differs, and True if earlier results remain valid."""
    usable: set[str | None] = {None}
    for job in campaign.jobs:
        text, file = job.to_json(), folder / layout.recipe_of(job)
        content = content_of(file) if file.exists() else b""
        earlier = None if content == text.encode() else _parse(content)
        if job.source in usable and (earlier is None or earlier.get("digest") == job.digest):
            usable.add(layout.output_of(job))
        yield job, text, earlier, layout.output_of(job) in usable


def _parse(recipe: bytes) -> Values:
    """Return the content of a recipe, or an empty dictionary if the text is not a recipe."""
    with contextlib.suppress(ValueError, RecursionError):
        values = json.loads(recipe)
        if isinstance(values, dict) and {"command", "digest"} <= values.keys():
            return values
    return {}


def unfinished_jobs(campaign: Campaign, folder: Path) -> list[Job]:
    """Return the jobs that a campaign would carry out in a folder."""
    left: dict[str | None, Job] = {}
    for job, _, _, valid in _recipes(campaign, folder):
        output = layout.output_of(job)
        if job.source in left or not (valid and (folder / output).exists()):
            left[output] = job
    return list(left.values())


def require_campaign_folder(campaign: Campaign, folder: Path, others: Sequence[str] = ()) -> None:
    """Raise InputError if a folder holds files that a campaign would replace or delete but that no campaign wrote.

    Also raises InputError if the folder holds links, or settings files of libraries, which would affect the jobs.
    `others` are names of further files that the campaign writes there.
    """
    layout.require_no_links(folder, others)
    for name in layout.SETTINGS:
        if (folder / name).exists():
            raise InputError(f"{folder / name} would change what the jobs do: delete it, or choose another --folder")
    recipes = list((folder / layout.RECIPES).glob("*.json"))
    planned = {folder / layout.recipe_of(job) for job in campaign.jobs}  # even if a full disk left a recipe empty
    foreign = [file for file in recipes if file not in planned and not _parse(content_of(file))]
    if not recipes:
        within = (file for name in layout.FOLDERS for file in (folder / name).rglob("*") if file.is_file())
        named = (folder / name for name in (layout.REPORT, layout.OVERVIEW, layout.PLAN, *others))
        foreign = [*(file for file in named if file.exists()), *within]
    if foreign:
        raise InputError(f"{foreign[0]} is not from a campaign, and could be replaced: choose another --folder")


def write_plan(campaign: Campaign, folder: layout.Name) -> list[str]:
    """Make the folders, write new and changed recipes and the plan, and remove recipes that are no longer planned.

    Returns sentences on the results of earlier recipes. Raises InputError if the folder holds links.
    """
    folder, same, moved = Path(folder), 0, 0
    layout.require_no_links(folder)
    for name in layout.FOLDERS:
        (folder / name).mkdir(parents=True, exist_ok=True)
    texts, times, unwanted = dict[Path, str](), dict[Path, int](), set((folder / layout.RECIPES).glob("*.json"))
    for job, text, earlier, valid in _recipes(campaign, folder):
        file = folder / layout.recipe_of(job)
        unwanted.discard(file)
        if valid and earlier is None:
            continue
        texts[file] = text
        if valid and earlier:
            times[file] = os.stat(file).st_mtime_ns
            same += (folder / layout.output_of(job)).exists()
        else:
            moved += _set_aside(folder, job)
    write_texts(texts)
    for file, time_ns in times.items():
        os.utime(file, ns=(time_ns, time_ns))
    for file in unwanted:
        file.unlink()
    _write_rows(campaign, folder)
    layout.leave_the_future([file.path for name in layout.FOLDERS for file in os.scandir(folder / name)], oldest=True)
    notes = [f"{same} results of the same jobs, planned differently, are kept"] * bool(same)
    return notes + [f"{moved} results of other parameters are moved to {folder / layout.OUTDATED}"] * bool(moved)


def _write_rows(campaign: Campaign, folder: Path) -> None:
    """Write plan.json."""
    rows = []
    for job in campaign.jobs:
        cost, device = job.cost, job.device
        needs = round(cost.memory, 1), round(cost.seconds() / 60.0, 2)
        rows.append(json.dumps(layout.Row(job.kind, job.name, job.source, device.cores, device.ranks, *needs)))
    names = [name for name in (layout.CAMPAIGN, *copied_names(campaign.use)) if (folder / name).exists()]
    files = json.dumps({name: file_sha256(folder / name) for name in names})
    lines = ",\n".join(rows)
    write_text(folder / layout.PLAN, f'{{"files": {files}, "jobs": [\n{lines}\n]}}\n')


def _set_aside(folder: Path, job: Job) -> bool:
    """Move a job's results of earlier parameters to the folder OUTDATED; returns True if there are any."""
    names = [name for name in (layout.output_of(job), *layout.products_of(job)) if (folder / name).exists()]
    for name in names:
        (folder / layout.OUTDATED).mkdir(exist_ok=True)
        (folder / name).replace(folder / layout.OUTDATED / Path(name).name)
    return layout.output_of(job) in names

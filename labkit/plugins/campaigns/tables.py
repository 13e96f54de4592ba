"""A campaign as tables for yade-batch: specimens, consolidations and loading paths in YADE."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from labkit.errors import InputError
from labkit.files.atomic import write_text
from labkit.files.writable import require_writable
from labkit.parameters import NUMBER
from labkit.plugins.campaigns.file import Campaign
from labkit.plugins.campaigns.jobs import Job
from labkit.plugins.campaigns.layout import output_of

SCRIPTS = {"specimen": "specimen.py", "consolidation": "consolidate.py", "run": "path.py"}


def write_tables(campaign: Campaign, folder: Path) -> list[Path]:
    """Write a table per kind of job into the folder; returns the files.

    Raises InputError if a job needs an engine other than yade, which yade-batch cannot start.
    """
    others = [job for job in campaign.jobs if job.device.name != "yade"]
    if others:
        problem = f"yade-batch runs only the engine yade, and {others[0].name} has the engine {others[0].device.name}"
        raise InputError(f"{problem}: give `engine: yade`")
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for kind in SCRIPTS:
        if jobs := [job for job in campaign.jobs if job.kind == kind]:
            files.append(folder / f"{kind}.table")
            require_writable(files[-1])
            write_text(files[-1], table_text(kind, jobs))
    return files


def table_text(kind: str, jobs: Sequence[Job]) -> str:
    """Return a table: a line with the columns, then a row per job; `*` stands for a default, %20 for a blank."""
    rows = [_row(job) for job in jobs]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    script = f"yade_scripts/{SCRIPTS[kind]}"
    lines = [f"# yade-batch --log {kind}.%.log {kind}.table {script}", " ".join(columns)]
    lines += [" ".join(row.get(name, "*") for name in columns) for row in rows]
    return "\n".join(lines) + "\n"


def _row(job: Job) -> dict[str, str]:
    row = {"path": f"'{job.path.name}'"} if job.path else {}
    if job.source:
        row["specimen"] = f"'{job.source.rpartition('/')[2]}'"
    for word in shlex.split(job.command):
        if word.startswith("--"):
            name, _, value = word[2:].partition("=")
            row[name.replace("-", "_")] = value if _is_plain(value) else f"'{value.replace(' ', '%20')}'"
    return {**row, "output": f"'{output_of(job).rpartition('/')[2]}'"}


def _is_plain(value: str) -> bool:
    """Return True for a number that Python reads without quotes; text such as `1d5` is none."""
    found = NUMBER.fullmatch(value)
    return found is not None and not found[2]

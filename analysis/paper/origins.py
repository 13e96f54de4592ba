"""Provenance of the report and its files: commands, code versions, computers, hashes, threads."""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import pandas

from analysis import manifest
from labkit.files import file_sha256, provenance_json, provenance_rows

DIGITS = 12  # digits of a hash, enough to distinguish files
ALIKE = ["engine", "engine version", "labkit", "commit", "machine", "libraries"]


def provenance(folder: Path, files: Sequence[Path], output: str | Path, command: str) -> dict[str, Any]:
    """Tables of the last section of the report.

    `files` are the files shown, and `command` is the command that wrote the page.
    """
    here = provenance_rows(json.loads(provenance_json(command, output=output)))
    runs = run_origins(folder)
    alike = runs.groupby(ALIKE, sort=False).size().rename("runs").reset_index() if len(runs) else runs
    return {
        "digits": DIGITS,
        "page": pandas.DataFrame([row for row in here.items() if row[0] != "inputs"], columns=["", " "]),
        "computers": alike.rename(columns={"machine": "computer"}),
        "runs": runs.drop(columns=ALIKE, errors="ignore"),
        "files": file_origins(folder, files),
    }


def run_origins(folder: Path) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per reduced run file: provenance and data hash of the full run."""
    rows = []
    for file in sorted((folder / "runs").glob("*.run.nc")):
        with netCDF4.Dataset(file) as run:
            known = json.loads(getattr(run, "source_provenance", getattr(run, "provenance", "{}")))
            digest = getattr(run, "source_sha256", getattr(run, "data_sha256", ""))
            engine = getattr(run, "engine", ""), str(getattr(run, "engine_version", ""))
        machine = known.get("machine", {})
        computer = f"{machine.get('cores', '?')} x {machine.get('processor', '?')}"
        libraries = ", ".join(f"{name} {version}" for name, version in known.get("libraries", {}).items())
        code = known.get("labkit_version", ""), short_commit(known.get("commit", "")), computer, libraries
        data = known.get("made", ""), digest[:DIGITS], known.get("command", "")
        rows.append((file.name.removesuffix(".run.nc"), *engine, *code, *data))
    return pandas.DataFrame(rows, columns=["run", *ALIKE, "made", "data", "command"])


def short_commit(commit: str) -> str:
    """The first 12 digits of a commit hash, with any text after the hash."""
    return re.sub(r"^([0-9a-f]{12})[0-9a-f]+", r"\1", commit)


def file_origins(folder: Path, files: Sequence[Path]) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per file shown on the page."""
    return pandas.DataFrame(
        {
            "file": [os.path.relpath(file, folder.parent) for file in files],
            "hash": [file_sha256(file)[:DIGITS] for file in files],
            "made by": [(manifest.provenance(file) or {}).get("command", "") for file in files],
        }
    )


def threads_of(attributes: Mapping[str, Any]) -> int:
    """Number of threads of a run, from the attributes of its file.

    Files written by labkit 0.1.0 lack the attribute `threads`; for those it is taken from the command in the
    provenance, or 1 if the command does not state it.
    """
    if "threads" in attributes:
        return int(attributes["threads"])
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--threads", type=int, default=1)
    command = json.loads(attributes.get("source_provenance", "{}")).get("command", "")
    return parser.parse_known_args(shlex.split(command))[0].threads

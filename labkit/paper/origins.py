"""Where the report and what it shows come from: commands, code, machines, hashes."""

from __future__ import annotations

import json
import os
import re

import netCDF4
import pandas

from labkit.paper.pieces import join, missing, table
from labkit.io.provenance import file_sha256, of_file, provenance, rows

DIGITS = 12  # of a hash, enough to tell files apart
ALIKE = ["engine", "engine version", "labkit", "commit", "machine", "libraries"]


def origins(folder, files, output, command, runs_command):
    """The last section of the report. `files`: what the page shows; `runs_command`: what makes the run files."""
    here = rows(json.loads(provenance(command, output=output)))
    page = pandas.DataFrame([row for row in here.items() if row[0] != "inputs"], columns=["", " "])
    runs = run_origins(folder)
    return join(
        "## Where it comes from", "### This page", table(page, "this page"), "### The runs",
        missing("runs", runs_command) if runs.empty else join(
            table(runs.groupby(ALIKE, sort=False).size().rename("runs").reset_index(), "where the runs were made"),
            table(runs.drop(columns=ALIKE), "every run", fold=True),
        ),
        "### The files behind this page", "SHA-256 of what the page shows, in short, and what made it where known.",
        table(file_origins(folder, files), "files", fold=True),
    )  # fmt: skip


def run_origins(folder):
    """A row per thin run file: what made the whole run, where, and the hash of its data; a pandas.DataFrame."""
    found = []
    for file in sorted((folder / "runs").glob("*.run.nc")):
        with netCDF4.Dataset(file) as run:
            known = json.loads(getattr(run, "source_provenance", getattr(run, "provenance", "{}")))
            digest = getattr(run, "source_sha256", getattr(run, "data_sha256", ""))
            engine = getattr(run, "engine", ""), str(getattr(run, "engine_version", ""))
        machine = known.get("machine", {})
        found.append({
            "run": file.name.removesuffix(".run.nc"), "engine": engine[0], "engine version": engine[1],
            "labkit": known.get("labkit_version", ""), "commit": short_commit(known.get("commit", "")),
            "machine": f"{machine.get('cores', '?')} x {machine.get('processor', '?')}",
            "libraries": ", ".join(f"{name} {version}" for name, version in known.get("libraries", {}).items()),
            "made": known.get("made", ""), "data": digest[:DIGITS], "command": known.get("command", ""),
        })  # fmt: skip
    return pandas.DataFrame(found)


def short_commit(commit):
    return re.sub(r"^([0-9a-f]{12})[0-9a-f]+", r"\1", commit)


def file_origins(folder, files):
    """A row per file that the page shows; a pandas.DataFrame."""
    return pandas.DataFrame([
        {"file": os.path.relpath(file, folder.parent), "hash": file_sha256(file)[:DIGITS],
         "made by": (of_file(file) or {}).get("command", "")}
        for file in files
    ])  # fmt: skip

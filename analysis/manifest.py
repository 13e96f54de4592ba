"""The manifest of a folder of results: the provenance of its files, with what they have in common said once.

labkit writes the provenance of a table or a page next to it. `collect` moves these files into `manifest.json`: a list
of records, each with the command, versions, computer and inputs of some files, and the time and hash of each of them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from labkit.files import provenance_of, write_text

MANIFEST, BESIDE = "manifest.json", ".provenance.json"
OWN = ("made", "sha256")  # what a file does not share with others


def collect(folder: str | Path) -> None:
    """Moves the provenance files in a folder into its manifest, which forgets files that are gone."""
    folder = Path(folder)
    beside = sorted(folder.glob(f"*{BESIDE}"))
    if not beside:
        return
    known = entries(folder)
    for file in beside:
        known[file.name.removesuffix(BESIDE)] = json.loads(file.read_text(encoding="utf-8"))
    there = {name: entry for name, entry in sorted(known.items()) if (folder / name).exists()}
    write_text(folder / MANIFEST, json.dumps(_records(there), indent=1) + "\n")
    for file in beside:
        file.unlink()


def entries(folder: Path) -> dict[str, dict[str, Any]]:
    """Name -> provenance of the files in the manifest of a folder."""
    file = folder / MANIFEST
    records = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
    return {
        name: {**{key: value for key, value in record.items() if key != "files"}, **own}
        for record in records
        for name, own in record["files"].items()
    }


def _records(known: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """The records of a manifest; `known`: see entries."""
    records = dict[str, dict[str, Any]]()
    for name, entry in known.items():
        common = {key: value for key, value in entry.items() if key not in OWN}
        record = records.setdefault(json.dumps(common), {**common, "files": {}})
        record["files"][name] = {key: entry[key] for key in OWN}
    return list(records.values())


def provenance(file: str | Path) -> dict[str, Any] | None:
    """Provenance of a file: in it, next to it, or in the manifest of its folder; None if it has none."""
    file = Path(file)
    return provenance_of(file) or entries(file.parent).get(file.name)

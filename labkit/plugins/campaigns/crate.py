"""A campaign as an RO-Crate 1.1: one JSON-LD file that describes all files of its folder and how each was made.

Archives such as Zenodo and WorkflowHub read `ro-crate-metadata.json` (https://w3id.org/ro/crate). ro-crate-py writes
this file from the provenance that each file of the campaign contains.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from labkit.errors import InputError
from labkit.files.atomic import write_text
from labkit.files.hashes import file_sha256
from labkit.files.provenance import provenance_of
from labkit.plugins.campaigns.layout import CAMPAIGN
from labkit.process.extras import install_command

KINDS = {".nc": "application/netcdf", ".csv": "text/csv", ".png": "image/png", ".md": "text/markdown",
         ".yaml": "application/yaml", ".json": "application/json"}  # fmt: skip
METADATA = "ro-crate-metadata.json"


def write_crate(folder: str | os.PathLike[str], license: str = "https://creativecommons.org/licenses/by/4.0/") -> Path:
    """Write `ro-crate-metadata.json` into the folder of a campaign; returns its path.

    `license` is the URL of the licence of the data. Raises InputError if the folder is not a campaign folder, or if
    ro-crate-py is missing.
    """
    folder = Path(folder)
    if not (folder / CAMPAIGN).is_file():
        raise InputError(f"{folder} is not the folder of a campaign: give the folder that `labkit campaign` wrote")
    try:
        from rocrate.rocrate import ROCrate
    except ImportError:
        raise InputError(f"a crate needs ro-crate-py: {install_command('crate')}") from None
    crate = ROCrate()
    crate.name = f"Campaign {folder.resolve().name}"
    crate.description = "Discrete element tests of granular soil, carried out by labkit"
    crate.license = license
    known = {
        path.resolve(): crate.add_file(
            path, dest_path=path.relative_to(folder).as_posix(), properties=_properties(path)
        )
        for path in _files(folder)
    }
    for path, entity in known.items():
        made = provenance_of(path)
        if made is not None:
            sources = [(path.parent / one["file"]).resolve() for one in made["inputs"]]
            _add_action(crate, made, entity, [known[source] for source in sources if source in known])
    write_text(folder / METADATA, json.dumps(crate.metadata.generate(), indent=4, sort_keys=True))
    return folder / METADATA


def _files(folder: Path) -> Iterator[Path]:
    """List results and their sources, without logs, caches and results of an earlier version of the campaign file."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        hidden = any(part.startswith(".") or part in ("outdated", "logs") for part in parts)
        if path.is_file() and path.suffix in KINDS and not hidden and path.name != METADATA:
            yield path


def _properties(path: Path) -> dict[str, object]:
    return {
        "name": path.name,
        "encodingFormat": KINDS[path.suffix],
        "contentSize": str(path.stat().st_size),
        "sha256": file_sha256(path),
    }


def _add_action(crate: Any, made: dict[str, object], result: Any, sources: list[object]) -> None:
    """Add the origin of a file: command, program, time and inputs."""
    from rocrate.model.contextentity import ContextEntity

    version = {"softwareVersion": made["labkit_version"], "identifier": made["commit"]}
    name = f"#labkit-{made['labkit_version']}-{made['commit']}"
    program = crate.dereference(name) or crate.add(
        ContextEntity(crate, name, {"@type": "SoftwareApplication", "name": "labkit", **version})
    )
    properties = {"@type": "CreateAction", "name": made["command"], "endTime": made["made"]}
    action = crate.add(ContextEntity(crate, f"#made-{result.id}", properties))
    action["instrument"], action["result"] = program, result
    if sources:
        action["object"] = sources
    crate.root_dataset.append_to("mentions", action)

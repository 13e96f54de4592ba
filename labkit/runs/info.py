"""What is in a state or run file, as text."""

from __future__ import annotations

import json
import os
from pathlib import Path

from labkit.dem.specimen import summary
from labkit.dem.state import read_state
from labkit.errors import InputError
from labkit.io import provenance
from labkit.io.files import labkit_kind, open_netcdf
from labkit.io.schema import RECORD, STATE


def describe_file(path: str | os.PathLike[str]) -> str:
    """A few lines on a labkit file. Raises InputError for another file."""
    kind = file_kind(path)
    if kind in ("figure", "statistics", "output"):
        return "\n".join([f"{path}: labkit {kind}", *provenance.words(provenance.of_file(path))])
    lines = [f"{path}: labkit {kind} file"]
    with open_netcdf(path, kind) as dataset:
        attributes = {name: dataset.getncattr(name) for name in dataset.ncattrs()}
        known = RECORD if kind == "run" else STATE
        extra = sorted(set(dataset.variables) - set(known))
        sizes = {name: len(d) for g in (dataset, *dataset.groups.values()) for name, d in g.dimensions.items()}
        groups = ", ".join(dataset.groups)
    known = attributes.pop("provenance", "")
    for name, value in attributes.items():
        lines.append(f"  {name:<18} {value}")
    lines.append("  sizes              " + ", ".join(f"{name} {size}" for name, size in sizes.items()))
    if groups:
        lines.append(f"  groups             {groups}")
    if extra:
        lines.append("  other variables    " + ", ".join(extra))
    if known:
        lines += ["provenance", *provenance.words(json.loads(known))]
    if kind == "state":
        for name, (value, unit) in summary(read_state(path)).items():
            lines.append(f"  {name:<24} {value:.6g} {unit}".rstrip())
    return "\n".join(lines)


def check_file(path: str | os.PathLike[str]) -> tuple[list[str], bool]:
    """Recomputes the hashes of a file: lines of text, and whether all are the same. Raises InputError for a file that
    has none.
    """
    file_kind(path)
    found = provenance.check(path)
    if not found:
        raise InputError(f"{path} holds no hashes: it is unfinished, or an earlier version of labkit made it")
    return [f"  {what:<40} {verdict}" for what, verdict in found], all(verdict == "same" for _, verdict in found)


def file_kind(path: str | os.PathLike[str]) -> str:
    """`state`, `run`, `statistics` of a campaign, `figure`, or `output` of another kind. Raises InputError."""
    if not Path(path).is_file():
        raise InputError(f"{path} does not exist: give a labkit state or run file")
    if Path(path).suffix.lower() == ".png" and provenance.of_file(path):
        return "figure"
    if Path(f"{path}{provenance.BESIDE}").exists():
        return "output"
    kind = labkit_kind(path)
    if kind not in ("state", "run", "statistics"):
        raise InputError(f"{path} is not a labkit file: give a state or run file")
    return kind

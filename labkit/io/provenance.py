"""Where a file comes from: command, code version, input files by hash, seed, library versions and computer.

`labkit info` shows it and `labkit info --check` recomputes the hashes. netCDF and PNG files hold it; beside any other
output, a table or a page, lies a file of its name and `.provenance.json`. Two hashes are kept apart: that of the bytes
of a file, and that of the data of an output (`data_sha256`: names, types, shapes and values, no attributes), which
is the same wherever the same data came out.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import json
import os
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

import labkit
from labkit.io.files import labkit_kind, write_text

BESIDE = ".provenance.json"  # what the name of a file that cannot hold its provenance is followed by
Name = str | os.PathLike[str]  # of a file

LIBRARIES = ("numpy", "netCDF4", "scipy", "numba", "xarray", "pandas", "matplotlib", "snakemake")


def provenance(
    command: str | None = None, inputs: Iterable[Name] = (), output: Name | None = None, seed: int | None = None
) -> str:
    """JSON text of the provenance of a file that is made now.

    `command`: as a person would type it (default: that of this process); `inputs`: the files that were read; `output`:
    the file that is made, to whose folder the names of the inputs are relative.
    """
    folder = Path(output).resolve().parent if output else Path.cwd()
    known = {
        "command": command or shlex.join(["labkit", *sys.argv[1:]]),
        "made": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "labkit_version": labkit.__version__,
        "commit": commit(),
        "python": platform.python_version(),
        "libraries": libraries(),
        "machine": machine(),
        "inputs": [
            {"file": os.path.relpath(Path(file).resolve(), folder), "sha256": file_sha256(file)} for file in inputs
        ],
    }
    if seed is not None:
        known["seed"] = int(seed)
    return json.dumps(known)


def write_told(file: Name, text: str, inputs: Iterable[Name] = (), command: str | None = None) -> None:
    """Writes a text file, and beside it where it comes from; `inputs`: the files that were read."""
    write_text(file, text)
    tell(file, inputs, command)


def tell(file: Name, inputs: Iterable[Name] = (), command: str | None = None) -> None:
    """Writes beside a file of any kind where it comes from, and its hash."""
    known = json.loads(provenance(command, inputs, file))
    write_text(f"{file}{BESIDE}", json.dumps({**known, "sha256": file_sha256(file)}, indent=1) + "\n")


@functools.cache
def commit() -> str:
    """The git commit that this code is from, with `+changes` if files differ from it; empty outside a checkout."""
    package = Path(__file__).resolve().parents[1]
    if _git(package, "rev-parse", "--show-prefix") != "labkit/":
        return ""  # installed, perhaps below somebody else's repository
    found = _git(package, "rev-parse", "HEAD") or ""
    return found + "+changes" * bool(found and _git(package, "status", "--porcelain", "--untracked-files=no"))


def _git(folder: Path, *words: str) -> str | None:
    """What git says, or None where it fails or is not there."""
    try:
        done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@functools.cache
def libraries() -> dict[str, str]:
    """Name -> version of the libraries that are installed for this interpreter."""
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


@functools.cache
def machine() -> dict[str, object]:
    """Name, processor, cores and system of this computer."""
    return {"name": platform.node(), "processor": processor(), "cores": os.cpu_count(), "system": platform.platform()}


def processor() -> str:
    """The model of the processor, as Linux has it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def file_sha256(file: Name) -> str:
    """SHA-256 of the bytes of a file, hexadecimal."""
    state = os.stat(file)
    return _sha256(os.fspath(file), state.st_ino, state.st_mtime_ns, state.st_size)


@functools.lru_cache(1024)  # one command may name the same inputs for each of its outputs
def _sha256(file, *state):
    digest = hashlib.sha256()
    with open(file, "rb") as handle:
        while part := handle.read(1 << 20):
            digest.update(part)
    return digest.hexdigest()


def data_sha256(dataset: netCDF4.Dataset) -> str:
    """SHA-256 of the variables of an open netCDF4.Dataset and of its groups, hexadecimal.

    The checkpoint of a run is left out: it has room that older checkpoints may have written to.
    """
    digest = hashlib.sha256()
    _add_group(digest, dataset)
    return digest.hexdigest()


ROWS = 4_000_000  # values read at a time


def _add_group(digest, group):
    for name in sorted(group.variables):
        variable = group.variables[name]
        digest.update(f"{group.path}/{name} {variable.dtype} {variable.shape}\n".encode())
        per_row = int(np.prod(variable.shape[1:], dtype=np.int64)) or 1
        rows = max(1, ROWS // per_row)
        for first in range(0, variable.shape[0] if variable.shape else 1, rows):
            part = variable[first : first + rows] if variable.shape else variable[...]
            digest.update(np.ascontiguousarray(np.ma.getdata(part)).tobytes())
    for name in sorted(set(group.groups) - {"checkpoint"}):
        _add_group(digest, group.groups[name])


def of_file(file: Name) -> dict[str, Any] | None:
    """The provenance of a file as a dictionary, or None if it has none."""
    file = Path(file)
    if (beside := Path(f"{file}{BESIDE}")).exists():
        return json.loads(beside.read_text())
    if file.suffix.lower() == ".png":
        from PIL import Image

        with Image.open(file) as image:
            text = image.info.get("provenance")
    elif labkit_kind(file) is None:
        return None
    else:
        with netCDF4.Dataset(file) as dataset:
            text = getattr(dataset, "provenance", None)
    return json.loads(text) if text else None


def check(file: Name) -> list[tuple[str, str]]:
    """(what, verdict) of every hash of a file: its data's, if it has one, and those of its inputs.

    The verdict is `same`, `differs` or `missing`.
    """
    file = Path(file)
    found = []
    known = of_file(file) or {}
    if "sha256" in known:
        found.append(("this file", "same" if file_sha256(file) == known["sha256"] else "differs"))
    elif labkit_kind(file):
        with netCDF4.Dataset(file) as dataset:
            stored = getattr(dataset, "data_sha256", None)
            if stored is not None:
                found.append(("the data of this file", "same" if data_sha256(dataset) == stored else "differs"))
    for item in known.get("inputs", []):
        source = file.resolve().parent / item["file"]
        if not source.is_file():
            found.append((f"input {item['file']}", "missing"))
        else:
            verdict = "same" if file_sha256(source) == item["sha256"] else "differs"
            found.append((f"input {item['file']}", verdict))
    return found


def words(known: Mapping[str, Any]) -> list[str]:
    """A provenance as lines of text."""
    return [f"  {name:<18} {value}" for name, value in rows(known).items()]


def rows(known: Mapping[str, Any]) -> dict[str, str]:
    """A provenance as text under the names that people read; what is empty is left out."""
    machine_ = known.get("machine", {})
    inputs = [f"{item['file']} sha256:{item['sha256'][:16]}" for item in known.get("inputs", [])]
    found = {
        "command": known.get("command", ""),
        "made": known.get("made", ""),
        "labkit": f"{known.get('labkit_version', '')} {known.get('commit') or 'no commit: installed, not a checkout'}",
        "seed": known.get("seed", ""),
        "inputs": ", ".join(inputs) or "none",
        "libraries": ", ".join(f"{name} {version}" for name, version in known.get("libraries", {}).items()),
        "python": known.get("python", ""),
        "machine": f"{machine_.get('name')}, {machine_.get('cores')} cores, {machine_.get('processor')}",
    }
    return {name: value for name, value in found.items() if value != ""}

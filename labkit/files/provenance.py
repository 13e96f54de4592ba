"""Provenance of a file: command, code version, input files with hashes, seed, library versions and computer.

`labkit info` shows the provenance and `labkit info --check` recomputes the hashes. netCDF and PNG files contain their
provenance; any other output, such as a table or a page, is accompanied by a file with the same name plus
`.provenance.json`. There are two kinds of hash: `sha256` covers all bytes of a file; `data_sha256` covers only the data
of a netCDF file (names, types, shapes and values, without attributes) and is therefore the same whenever the same data
are produced. A netCDF file ends with the hash of all its bytes (labkit.files.hashes).
"""

from __future__ import annotations

import functools
import importlib.metadata
import json
import os
import platform
import shlex
import subprocess
import sys
import time
import warnings
from collections.abc import Iterable
from pathlib import Path

from labkit.errors import InputError
from labkit.files.atomic import write_text
from labkit.files.hashes import Name, file_sha256
from labkit.files.netcdf import attribute_of, hash_verdict, labkit_kind
from labkit.files.schema import is_provenance
from labkit.parameters import Values
from labkit.text.foreign import noted_files, require_regular
from labkit.version import __version__

BESIDE = ".provenance.json"  # suffix of the file with the provenance of a table or a page

LIBRARIES = ("numpy", "netCDF4", "scipy", "numba", "xarray", "pandas", "matplotlib", "snakemake")


def provenance_json(
    command: str | None = None,
    inputs: Iterable[Name] = (),
    output: Name | None = None,
    seed: int | None = None,
    task: str | None = None,
) -> str:
    """Return the provenance of a file that is being created, as JSON text.

    Args:
        command: Command as typed (default: the command of this process).
        inputs: Files that were read, apart from text files that a command read (labkit.text.foreign.noting_files);
            names are stored relative to the folder of the output.
        output: File being created.
        seed: Random seed.
        task: What was done, e.g. specimen or consolidation.
    """
    folder = Path(os.path.realpath(output)).parent if output else Path.cwd()
    files = dict.fromkeys(map(os.path.realpath, inputs), "") | noted_files()
    record: dict[str, object] = {
        "command": command or shlex.join(["labkit", *sys.argv[1:]]),
        "made": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "labkit_version": __version__,
        "commit": commit(),
        "python": platform.python_version(),
        "libraries": libraries(),
        "machine": machine(),
        "inputs": [
            {"file": os.path.relpath(file, folder), "sha256": sha256 or file_sha256(file)}
            for file, sha256 in files.items()
        ],
    }
    if seed is not None:
        record["seed"] = int(seed)
    if task is not None:
        record["task"] = task
    return json.dumps(record)


def write_with_provenance(file: Name, text: str, inputs: Iterable[Name] = (), command: str | None = None) -> None:
    """Write a text file and its provenance; `inputs` are the files that were read."""
    write_text(file, text)
    write_provenance(file, inputs, command)


def write_provenance(file: Name, inputs: Iterable[Name] = (), command: str | None = None) -> None:
    """Write the provenance and the hash of an existing file to `file` + `.provenance.json`."""
    record = json.loads(provenance_json(command, inputs, file))
    write_text(f"{file}{BESIDE}", json.dumps({**record, "sha256": file_sha256(file)}, indent=1) + "\n")


@functools.cache
def commit() -> str:
    """Return the Git commit of this code, with `+changes` if tracked files are modified; empty outside a checkout."""
    package = Path(__file__).resolve().parents[1]
    if _git(package, "rev-parse", "--show-prefix") != "labkit/":
        return ""  # labkit is installed, perhaps inside a different repository
    head = _git(package, "rev-parse", "HEAD") or ""
    return head + "+changes" * bool(head and _git(package, "status", "--porcelain", "--untracked-files=no"))


def _git(folder: Path, *arguments: str) -> str | None:
    """Return the output of a git command; None if it fails or git is not installed."""
    try:
        done = subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@functools.cache
def libraries() -> dict[str, str]:
    """Return the versions of the libraries installed for this interpreter, name -> version."""
    versions = {
        distribution.name: distribution.version
        for name in LIBRARIES
        for distribution in importlib.metadata.distributions(name=name)
    }
    return {name: versions[name] for name in LIBRARIES if name in versions}


@functools.cache
def machine() -> dict[str, object]:
    """Return the name, processor, number of cores and operating system of this computer."""
    return {"name": platform.node(), "processor": processor(), "cores": os.cpu_count(), "system": platform.platform()}


def processor() -> str:
    """Return the processor model as reported by Linux or, on other systems, by Python."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def provenance_of(file: Name) -> Values | None:
    """Return the provenance of a file as a dictionary; None if the file has no provenance."""
    file = Path(file)
    if (beside := Path(f"{file}{BESIDE}")).exists():
        return _read(beside)
    if file.suffix.lower() == ".png":
        text = _text_in_picture(file)
    elif labkit_kind(file) is None:
        return None
    else:
        text = attribute_of(file, "provenance")
    return _parse(text, file) if text else None


def _text_in_picture(file: Path) -> str | None:
    """Return the provenance in a PNG. Raises InputError if it is none, or would fill the memory."""
    from PIL import Image

    require_regular(file)
    try:
        with warnings.catch_warnings(action="error"), Image.open(file) as image:
            return image.info.get("provenance")
    except (Image.DecompressionBombError, Warning, OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{file} is not a PNG that labkit wrote ({error}): give another file") from None


def _read(beside: Path) -> Values:
    require_regular(beside, "restore a copy, or delete it")
    try:
        return _parse(beside.read_bytes(), beside)
    except OSError:
        return _parse("", beside)


def _parse(text: str | bytes, file: Path) -> Values:
    try:
        record = json.loads(text)
    except (ValueError, RecursionError):
        record = None
    if not is_provenance(record):
        raise InputError(f"{file} is damaged: restore a copy, or delete it")
    return record


def has_changed(file: Name) -> bool:
    """Return True if a file differs from the hash in its provenance file. Raises InputError if this is damaged."""
    beside = Path(f"{file}{BESIDE}")
    return beside.exists() and _read(beside).get("sha256") not in (None, file_sha256(file))


def check(file: Name) -> list[tuple[str, str]]:
    """Return (item, verdict) for every hash that a file stores: of its content or data, and of its input files.

    The verdict is `same`, `differs` or `missing`.
    """
    file = Path(file)
    record = provenance_of(file) or {}
    if "sha256" in record:
        verdicts = [("this file", _verdict(file, record["sha256"]))]
    else:
        verdict = hash_verdict(file) if labkit_kind(file) else None
        verdicts = [("the data of this file", verdict)] if verdict else []
    inputs = {
        f"input {item['file']}": (file.resolve().parent / item["file"], item) for item in record.get("inputs", [])
    }
    return verdicts + [(name, _verdict(source, item["sha256"])) for name, (source, item) in inputs.items()]


def _verdict(file: Path, sha256: str) -> str:
    if not file.is_file():
        return "missing"
    return "same" if file_sha256(file) == sha256 else "differs"


def provenance_rows(record: Values) -> dict[str, str]:
    """Return a provenance as label -> text, without empty values."""
    computer = record.get("machine", {})
    inputs = [f"{item['file']} sha256:{item['sha256'][:16]}" for item in record.get("inputs", [])]
    labelled = {
        "command": record.get("command", ""),
        "created": record.get("made", ""),
        "labkit": f"{record.get('labkit_version', '')} {record.get('commit') or '(installed, no commit recorded)'}",
        "seed": record.get("seed", ""),
        "inputs": ", ".join(inputs) or "none",
        "libraries": ", ".join(f"{name} {version}" for name, version in record.get("libraries", {}).items()),
        "python": record.get("python", ""),
        "computer": f"{computer.get('name')}, {computer.get('cores')} cores, {computer.get('processor')}",
    }
    return {name: value for name, value in labelled.items() if value != ""}

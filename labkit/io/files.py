"""Atomic writing of files, reading of netCDF files, and the error messages for files that cannot be used."""

from __future__ import annotations

import contextlib
import glob
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal

import netCDF4

from labkit.errors import InputError
from labkit.io.conventions import TIME
from labkit.io.schema import CONTACTS, ESSENTIAL, GRAINS, SIZES, Variable

netCDF4.set_chunk_cache(1 << 20)  # bytes per variable instead of the usual 64 MB: data are read and written only once


def require_writable(path: str | os.PathLike[str], kind: str | None = None) -> None:
    """Raises InputError unless a file can be written at `path`. Leaves no file behind.

    kind: the kind of labkit file that may be overwritten if `path` exists; None: any file that is not a labkit file.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory: give a file name")
    if len(path.name.encode()) > 200:
        raise InputError(f"{path.name[:40]}... is too long for a file name: choose another -o")
    if path.exists():
        if not path.is_file():
            raise InputError(f"{path} is not a regular file: choose another -o")
        existing = labkit_kind(path)
        if (kind or existing) and existing != kind:
            raise InputError(f"{path} is {_described(existing)}: it would be overwritten; choose another -o")
    if not path.parent.is_dir():
        raise InputError(f"{path.parent} is not a directory: create it first, or choose another -o")
    try:
        handle, probe = tempfile.mkstemp(prefix=".labkit-", dir=path.parent)
    except OSError as error:
        raise InputError(f"{path.parent} is not writable ({error.strerror}): choose another -o") from None
    os.close(handle)
    os.unlink(probe)


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Context with a temporary file name; the file is renamed to `path` on success and deleted otherwise."""
    path = Path(path).resolve()
    temporary = path.parent / f".{path.name}.{os.getpid()}.tmp"
    try:
        yield temporary
        with open(temporary, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def make_folder(path: str | os.PathLike[str], option: str) -> Path:
    """Path of a folder, which is created if missing. Raises InputError, with the option, if it is not writable."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option} {path} cannot be created ({error.strerror}): choose another folder") from None
    require_writable(path / "README.md")
    return path


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes a text file atomically."""
    with whole_file(path) as temporary:
        temporary.write_text(text)


def remove_leftovers(path: Path) -> None:
    """Removes the temporary files of processes killed in whole_file(path).

    Call it only while holding the lock on `path`.
    """
    for temporary in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def open_netcdf(path: str | os.PathLike[str], kind: str) -> Iterator[netCDF4.Dataset]:
    """Context with a netCDF4.Dataset open for reading. Raises InputError if it is not a labkit `kind` file."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path} does not exist: give a labkit {kind} file")
    try:
        dataset = netCDF4.Dataset(path)
    except PermissionError:
        raise InputError(f"{path} is not readable: change its permissions, or choose another file") from None
    except OSError:
        raise InputError(f"{path} is not a netCDF file: give a labkit {kind} file") from None
    with dataset:
        actual = getattr(dataset, "labkit_file", None)
        if actual != kind:
            raise InputError(f"{path} is {_described(actual)}: give a labkit {kind} file")
        if kind == "run":
            _require_run(path, dataset)
        yield dataset


def labkit_kind(path: str | os.PathLike[str]) -> str | None:
    """Kind of a labkit file, e.g. `state` or `run`; None for any other file."""
    try:
        with netCDF4.Dataset(path) as dataset:
            return getattr(dataset, "labkit_file", None)
    except OSError:
        return None


def _described(kind: str | None) -> str:
    return f"a labkit {kind} file" if kind else "not a labkit file"


def _require_run(path: Path, dataset: netCDF4.Dataset) -> None:
    """Raises InputError if a run file lacks a group, an attribute or a variable that every analysis needs."""
    groups = dataset.groups
    for group, names in ((dataset, ESSENTIAL), (groups.get("contacts"), CONTACTS), (groups.get("grains"), GRAINS)):
        missing = [name for name in names if group is None or name not in group.variables]
        if missing:
            raise InputError(f"{path} is damaged ({missing[0]} is missing): repeat the run")
    for name in ("scene", "path", "path_parameters", "complete"):
        if name not in dataset.ncattrs():
            raise InputError(f"{path} is damaged (the attribute {name} is missing): repeat the run")


def create_variables(
    group: netCDF4.Dataset,
    table: Mapping[str, Variable],
    sizes: Mapping[str, int],
    compression: Literal["zlib"] | None = "zlib",
) -> None:
    """Creates the variables of a schema table in a netCDF group; dimensions without a size are unlimited."""
    known = {**SIZES, **sizes}
    for variable in table.values():
        for dimension in variable.dimensions:
            if _find_dimension(group, dimension) is None:
                group.createDimension(dimension, known.get(dimension))
        chunks = [_chunk_size(name, known.get(name)) for name in variable.dimensions]
        created = group.createVariable(
            variable.name,
            variable.dtype,
            variable.dimensions,
            compression=compression,
            complevel=1,
            shuffle=True,
            chunksizes=chunks,
        )
        created.units = variable.units
        created.long_name = variable.long_name
        if variable.name == "time":
            created.setncatts(TIME)


_CHUNK = {"time": 256, "snapshot": 1, "contact": 8192, "grain": 16384}


def _chunk_size(dimension: str, size: int | None) -> int:
    """Chunk length along a dimension; `size` is None for an unlimited dimension."""
    if size is None:
        return _CHUNK[dimension]
    return min(_CHUNK.get(dimension, size), max(size, 1))


def _find_dimension(group: netCDF4.Dataset, name: str) -> netCDF4.Dimension | None:
    owner: netCDF4.Dataset | None = group
    while owner is not None:
        if name in owner.dimensions:
            return owner.dimensions[name]
        owner = owner.parent
    return None

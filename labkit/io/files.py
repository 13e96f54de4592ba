"""netCDF files that are either whole or not there, and the messages for those that cannot be used."""

from __future__ import annotations

import contextlib
import glob
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import netCDF4

from labkit.errors import InputError
from labkit.io.schema import CONTACTS, ESSENTIAL, GRAINS, SIZES, Variable

netCDF4.set_chunk_cache(1 << 20)  # bytes for each variable, where 64 MB are usual: files are read and written once


def require_writable(path: str | os.PathLike[str], kind: str | None = None) -> None:
    """Raises InputError unless a file could be put at `path`. Leaves nothing behind.

    `kind`: the labkit file that an existing file at `path` must be to be written over; None: any file that is not
    a labkit file.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory: give the name of a file")
    if len(path.name.encode()) > 200:
        raise InputError(f"{path.name[:40]}... is too long a name: choose another -o")
    if path.exists():
        if not path.is_file():
            raise InputError(f"{path} is not an ordinary file: choose another -o")
        found = labkit_kind(path)
        if (kind or found) and found != kind:
            raise InputError(f"{path} is {_what(found)}: it would be overwritten; choose another -o")
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
    """Gives a temporary name beside `path`; it becomes `path` when the block ends well, else it goes."""
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
    """The folder as a Path, made if need be. Raises InputError, which names the option, when it cannot hold files."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option} {path} cannot be a folder ({error.strerror}): give another") from None
    require_writable(path / "README.md")
    return path


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes a text file, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text)


def remove_leftovers(path: Path) -> None:
    """Removes what processes that were killed in whole_file(path) left; only for the one writer of `path`."""
    for temporary in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def open_netcdf(path: str | os.PathLike[str], kind: str) -> Iterator[netCDF4.Dataset]:
    """A netCDF4.Dataset open for reading. Raises InputError when it is not a labkit `kind` file."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path} does not exist: give a labkit {kind} file")
    try:
        dataset = netCDF4.Dataset(path)
    except PermissionError:
        raise InputError(f"{path} may not be read: change its rights, or give another") from None
    except OSError:
        raise InputError(f"{path} is not a netCDF file: give a labkit {kind} file") from None
    with dataset:
        found = getattr(dataset, "labkit_file", None)
        if found != kind:
            raise InputError(f"{path} is {_what(found)}: give a labkit {kind} file")
        if kind == "run":
            _require_run(path, dataset)
        yield dataset


def labkit_kind(path: str | os.PathLike[str]) -> str | None:
    """`state`, `run`, or None for any other file."""
    try:
        with netCDF4.Dataset(path) as dataset:
            return getattr(dataset, "labkit_file", None)
    except OSError:
        return None


def _what(kind: str | None) -> str:
    return f"a labkit {kind} file" if kind else "no labkit file"


def _require_run(path: Path, dataset: netCDF4.Dataset) -> None:
    """Raises InputError if a run file lacks groups, attributes or variables without which nothing can be said of it."""
    groups = dataset.groups
    for group, names in ((dataset, ESSENTIAL), (groups.get("contacts"), CONTACTS), (groups.get("grains"), GRAINS)):
        missing = [name for name in names if group is None or name not in group.variables]
        if missing:
            raise InputError(f"{path} is damaged, it lacks {missing[0]}: run it again")
    for name in ("scene", "path", "path_parameters", "complete"):
        if name not in dataset.ncattrs():
            raise InputError(f"{path} is damaged, it lacks the attribute {name}: run it again")


def create_variables(
    group: netCDF4.Group, table: Mapping[str, Variable], sizes: Mapping[str, int], compression: str | None = "zlib"
) -> None:
    """Creates the variables of a schema table in a netCDF group; dimensions without a size are unlimited."""
    known = {**SIZES, **sizes}
    for variable in table.values():
        for dimension in variable.dimensions:
            if _find_dimension(group, dimension) is None:
                group.createDimension(dimension, known.get(dimension))
        chunks = [min(_CHUNK.get(d, known.get(d)), max(known.get(d, 1 << 20), 1)) for d in variable.dimensions]
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


_CHUNK = {"time": 256, "snapshot": 1, "contact": 8192, "grain": 16384}


def _find_dimension(group: netCDF4.Group | None, name: str) -> netCDF4.Dimension | None:
    while group is not None:
        if name in group.dimensions:
            return group.dimensions[name]
        group = group.parent
    return None

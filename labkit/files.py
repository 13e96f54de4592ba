"""netCDF files that are either whole or not there, and the messages for those that cannot be used."""

from __future__ import annotations

import contextlib
import glob
import os
import tempfile
from pathlib import Path

import netCDF4

from labkit.errors import InputError
from labkit.schema import SIZES


def require_writable(path):
    """Raises InputError unless a file could be put at `path`. Leaves nothing behind."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory: give the name of a file")
    if not path.parent.is_dir():
        raise InputError(f"{path.parent} is not a directory: create it first, or give another -o")
    try:
        handle, probe = tempfile.mkstemp(prefix=".labkit-", dir=path.parent)
    except OSError as error:
        raise InputError(f"{path.parent} is not writable ({error.strerror}): give another -o") from None
    os.close(handle)
    os.unlink(probe)


@contextlib.contextmanager
def whole_file(path):
    """Gives a temporary name beside `path`; it becomes `path` when the block ends well, else it goes."""
    path = Path(path)
    temporary = path.parent / f".{path.name}.{os.getpid()}.tmp"
    try:
        yield temporary
        with open(temporary, "rb") as handle:
            os.fsync(handle.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def remove_leftovers(path):
    """Removes what processes that were killed in whole_file(path) left; only for the one writer of `path`."""
    for temporary in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def open_netcdf(path, kind):
    """A netCDF4.Dataset open for reading. Raises InputError when it is not a labkit `kind` file."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path} does not exist: give a labkit {kind} file")
    try:
        dataset = netCDF4.Dataset(path)
    except OSError:
        raise InputError(f"{path} is not a netCDF file: give a labkit {kind} file") from None
    with dataset:
        found = getattr(dataset, "labkit_file", None)
        if found != kind:
            what = f"a labkit {found} file" if found else "a netCDF file of another program"
            raise InputError(f"{path} is {what}: give a labkit {kind} file")
        yield dataset


def create_variables(group, table, sizes, compression="zlib"):
    """Creates the variables of a schema table in a netCDF group; dimensions without a size are unlimited."""
    known = {**SIZES, **sizes}
    for variable in table.values():
        for dimension in variable.dimensions:
            if _find_dimension(group, dimension) is None:
                group.createDimension(dimension, known.get(dimension))
        chunks = [min(_CHUNK.get(d, known.get(d)), max(known.get(d, 1 << 20), 1)) for d in variable.dimensions]
        created = group.createVariable(
            variable.name, variable.dtype, variable.dimensions, compression=compression, complevel=1,
            shuffle=True, chunksizes=chunks,
        )
        created.units = variable.units
        created.long_name = variable.long_name


_CHUNK = {"time": 256, "snapshot": 1, "contact": 8192, "grain": 16384}


def _find_dimension(group, name):
    while group is not None:
        if name in group.dimensions:
            return group.dimensions[name]
        group = group.parent
    return None

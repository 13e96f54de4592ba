"""Hashes: of all bytes of a file, and of the data in a netCDF file, which HDF5 itself protects from damage."""

from __future__ import annotations

import functools
import hashlib
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from labkit.files.schema import AXES

if TYPE_CHECKING:
    import netCDF4

Name = str | os.PathLike[str]  # name of a file
Result = TypeVar("Result")

BLOCK = 1 << 20  # bytes read at a time
CHUNK = 500_000  # values read at a time


def identity(file: Name) -> tuple[int, int, int, int]:
    """Return inode, two times in ns and size in bytes; at least one of them changes if a file is replaced or written.

    `cp -p` restores the time of the content, but no program can set the time of the last change of any kind.
    """
    state = os.stat(file)
    return state.st_ino, state.st_mtime_ns, state.st_ctime_ns, state.st_size


def once_per_version(function: Callable[[Name], Result]) -> Callable[[Name], Result]:
    """Return a function of a file that stores its results until the file changes: a command often calls it again."""
    remember = functools.lru_cache(1024)(lambda file, *_: function(file))
    return functools.wraps(function)(lambda file: remember(os.fspath(file), *identity(file)))


@once_per_version
def file_sha256(file: Name) -> str:
    """Return the SHA-256 of all bytes of a file, hexadecimal."""
    digest = hashlib.sha256()
    with open(file, "rb") as handle:
        while part := handle.read(BLOCK):
            digest.update(part)
    return digest.hexdigest()


def data_sha256(dataset: netCDF4.Dataset) -> str:
    """Return the SHA-256 of the variables of an open netCDF4.Dataset and its groups, hexadecimal.

    The checkpoint of a run is left out because its arrays may contain leftover data from earlier checkpoints, and so
    are the labels of components, which files of earlier versions lack. Raises DamagedVariable for a variable that
    cannot be read.
    """
    return sha256_of_groups(_groups_of(dataset))


def sha256_of_groups(groups: Iterable[tuple[str, Mapping[str, Any]]]) -> str:
    """Return the SHA-256 of groups, given as (path, variables or arrays by name): the data_sha256 of the file."""
    digest = hashlib.sha256()
    for path, variables in groups:
        for name in sorted(variables):
            digest.update(f"{path}/{name} {variables[name].dtype} {variables[name].shape}\n".encode())
            for part in parts_of(variables[name]):
                digest.update(part.tobytes())
    return digest.hexdigest()


class DamagedVariable(RuntimeError):
    """A variable of a netCDF file that HDF5 cannot read."""


def values_of(variable: Any, rows: object = ...) -> np.ndarray:
    """Return all values, or some rows, of an array or of a variable in an open file. Raises DamagedVariable."""
    try:
        return np.ascontiguousarray(np.ma.getdata(variable[rows]))
    except (RuntimeError, OSError, IndexError, ValueError):
        raise DamagedVariable(f"{variable.name} cannot be read") from None


def parts_of(variable: Any) -> Iterator[np.ndarray]:
    """Yield the values of a variable of an open file, or of an array, some rows at a time. Raises DamagedVariable."""
    if not variable.shape:
        yield values_of(variable)
        return
    rows = max(1, CHUNK // max(1, math.prod(variable.shape[1:])))
    for first in range(0, variable.shape[0], rows):
        yield values_of(variable, slice(first, first + rows))


def _groups_of(group: netCDF4.Dataset) -> Iterator[tuple[str, Mapping[str, netCDF4.Variable]]]:
    """Yield (path, variables) of a group and of all groups within it, except checkpoints and labels of components."""
    yield group.path, {name: variable for name, variable in group.variables.items() if name not in AXES}
    for name in sorted(set(group.groups) - {"checkpoint"}):
        yield from _groups_of(group.groups[name])

"""Hashes of files, and the seal: the SHA-256 of all bytes of a netCDF file, appended to it.

A netCDF-4 file may be longer than its content; HDF5 ignores the bytes that follow. labkit appends the line

    labkit sha256 <64 hexadecimal digits>

to every netCDF file, also at each save of an unfinished run, and checks this line before it opens the file. The seal
also covers what `data_sha256` and fletcher32 do not: attributes, the checkpoint and HDF5's own tables. Computing it
takes 0.5 ns per byte. A program that changes the file with the netCDF library removes the line, but the attribute
`seal` still shows that the file had a seal.
"""

from __future__ import annotations

import functools
import hashlib
import math
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from labkit.files.schema import AXES

if TYPE_CHECKING:
    import netCDF4

Name = str | os.PathLike[str]  # name of a file
Result = TypeVar("Result")

MARK = b"\nlabkit sha256 "
SEAL = len(MARK) + 64 + 1  # bytes in the last line of a sealed file
NOTE = "the last line of this file is the SHA-256 of all bytes before it"  # the attribute `seal`
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
    return _sha256(file, os.path.getsize(file))


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


def seal(file: Name) -> None:
    """Append the hash of all bytes to a netCDF file without a seal."""
    digest = _sha256(file, os.path.getsize(file))
    with open(file, "ab") as handle:
        handle.write(MARK + digest.encode() + b"\n")


def copy_unsealed(file: Name, to: Name) -> None:
    """Copy a netCDF file without its seal, so that the copy can be extended."""
    shutil.copyfile(file, to)
    if (sealed := _seal_of(file)) is not None:
        os.truncate(to, sealed[0])


@once_per_version
def seal_is_right(file: Name) -> bool | None:
    """Return True if the bytes of a sealed file match its hash, False if not; None for a file without a seal."""
    sealed = _seal_of(file)
    return None if sealed is None else _sha256(file, sealed[0]) == sealed[1]


def _seal_of(file: Name) -> tuple[int, str] | None:
    """Return the number of bytes before the seal, and the hash in it; None if the file has no seal."""
    size = os.path.getsize(file) - SEAL
    if size < 0:
        return None
    with open(file, "rb") as handle:
        handle.seek(size)
        end = handle.read(SEAL)
    return (size, end[len(MARK) : -1].decode("latin-1")) if end.startswith(MARK) else None


def _sha256(file: Name, size: int) -> str:
    """Return the SHA-256 of the first `size` bytes of a file, hexadecimal."""
    digest = hashlib.sha256()
    with open(file, "rb") as handle:
        while size and (part := handle.read(min(BLOCK, size))):
            digest.update(part)
            size -= len(part)
    return digest.hexdigest()


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

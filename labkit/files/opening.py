"""Opens a file with the netCDF library, or as an archive of arrays (labkit.files.arrays)."""

from __future__ import annotations

import os
import secrets
import struct
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from labkit.errors import InputError
from labkit.files import arrays

if TYPE_CHECKING:
    import netCDF4


HEAD = 1 << 20  # bytes at the start of a file; netCDF puts the references between variables there


def dataset_at(path: str | os.PathLike[str], mode: Literal["r", "w", "a"] = "r") -> netCDF4.Dataset:
    """Open exactly this file: the netCDF library changes some relative names, such as ` x.nc` and `c:/x.nc`.

    A new file is an archive if it is named so, or if there is no netCDF library. Raises InputError for a name that the
    library changes even in an absolute path, and for changes to an archive; OSError for damage.
    """
    require_name(path)
    archive: Any = arrays.Dataset
    try:
        import netCDF4
    except ImportError:  # as in a browser
        return archive(Path(path), mode)
    if mode == "w" and arrays.ENDING in Path(path).suffixes:  # not the last one of a temporary file
        return archive(Path(path), mode)
    if mode != "w" and arrays.is_archive(path):
        unique = secrets.token_hex(8)  # HDF5 refuses the name of a file that is open
        return arrays.copy(archive(Path(path), mode), netCDF4.Dataset(unique, "w", diskless=True))
    if mode != "w":
        _require_whole_heaps(path)
    return netCDF4.Dataset(os.path.abspath(path), mode)


def _require_whole_heaps(path: str | os.PathLike[str]) -> None:
    """Raise OSError if a length in a global heap, which has no checksum, is wrong: HDF5 would search there without end.

    HDF5 File Format Specification, III.E: a heap has a length and its objects; number 0 is the free space.
    """
    with open(path, "rb") as file:
        head = file.read(HEAD)
    start = -1
    while (start := head.find(b"GCOL\1\0\0\0", start + 1)) >= 0:
        at, end = start + 16, start + int.from_bytes(head[start + 8 : start + 16], "little")
        while at + 16 <= min(end, len(head)):
            number, size = struct.unpack_from("<H6xQ", head, at)
            step = 16 + -(-size // 8) * 8 if number else size
            if not 0 < step <= end - at:
                raise OSError(f"{path}: a length in its global heap is wrong")
            at += step


def require_name(path: str | os.PathLike[str]) -> None:
    """Raise InputError for a file name that the netCDF library cannot handle, or takes for another name."""
    if os.sep != "\\" and "\\" in os.path.abspath(path):
        raise InputError(
            f"{path} has a backslash in its path, which netCDF takes for `/`: rename the file or the folder"
        )
    try:
        os.fspath(path).encode(sys.getfilesystemencoding())
    except UnicodeEncodeError:
        shown = os.fspath(path).encode("ascii", "backslashreplace").decode()
        raise InputError(f"the file name {shown} is not {sys.getfilesystemencoding()} text: rename the file") from None

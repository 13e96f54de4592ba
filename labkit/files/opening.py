"""Opens a file with the netCDF library, or as an archive of arrays (labkit.files.arrays)."""

from __future__ import annotations

import os
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from labkit.errors import InputError
from labkit.files import arrays

if TYPE_CHECKING:
    import netCDF4


def dataset_at(path: str | os.PathLike[str], mode: Literal["r", "w", "a"] = "r") -> netCDF4.Dataset:
    """Open exactly this file: the netCDF library changes some relative names, such as ` x.nc` and `c:/x.nc`.

    A new file is an archive if it is named so, or if there is no netCDF library. Raises InputError for a name that the
    library changes even in an absolute path, and for changes to an archive.
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
    return netCDF4.Dataset(os.path.abspath(path), mode)


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

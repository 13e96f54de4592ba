"""The lock around netCDF and HDF5, which can serve only one thread at a time, for both labkit and xarray.

labkit takes the lock LIBRARY wherever it uses these libraries, and passes LIBRARY to xarray for the files that labkit
opens. xarray has a lock of its own, under which it reads values, but not attributes. LIBRARY therefore takes both
locks; the thread that holds LIBRARY may take it again. This thread must not read a Dataset that the user opened,
because xarray's own lock cannot be taken twice.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import types
from collections.abc import Iterator
from typing import TYPE_CHECKING

from labkit.files.atomic import reserve, whole_file

if TYPE_CHECKING:
    import h5py

CHUNK_CACHE = 1 << 20  # bytes per variable instead of the usual 64 MB: data are read and written only once
OWN = threading.RLock()


class LibraryLock:
    """The locks of labkit and xarray together; while they are held, variables are opened with a small chunk cache."""

    def __init__(self) -> None:
        """Create the lock, which no thread holds."""
        self._depth, self._rest = 0, contextlib.ExitStack()

    def acquire(self, blocking: bool = True) -> bool:
        """Wait until no other thread uses netCDF or HDF5 through labkit, or through xarray once it is imported.

        If `blocking` is False, return False instead of waiting. xarray makes such a call when Python frees a file,
        which may happen at any time, even while this thread is taking the lock.
        """
        if not OWN.acquire(blocking):
            return False
        try:
            rest = self._rest if self._depth else _with_rest(blocking)
        except BaseException:
            OWN.release()
            raise
        if rest is None:
            OWN.release()
            return False
        self._rest, self._depth = rest, self._depth + 1
        return True

    def release(self) -> None:
        """Let other threads use the libraries, unless this thread took the lock more than once."""
        self._depth -= 1
        if not self._depth:
            self._rest.close()
        OWN.release()

    def __enter__(self) -> None:
        with contextlib.suppress(ImportError):  # a browser has no such library
            import netCDF4 as netCDF4  # whose cache the lock sets

        self.acquire()

    def __exit__(self, *error: object) -> None:
        self.release()

    def __reduce__(self) -> str:
        """Make a copy refer to this lock."""
        return "LIBRARY"


LIBRARY = LibraryLock()
if hasattr(os, "register_at_fork"):  # otherwise a child could wait forever for a lock that a thread of its parent held
    os.register_at_fork(before=LIBRARY.acquire, after_in_parent=LIBRARY.release, after_in_child=LIBRARY.release)


def _with_rest(blocking: bool) -> contextlib.ExitStack | None:
    """Take xarray's lock and set the chunk cache; return an ExitStack that undoes both, or None instead of waiting."""
    with contextlib.ExitStack() as taken:
        theirs = getattr(sys.modules.get("xarray.backends.netCDF4_"), "NETCDF4_PYTHON_LOCK", None)
        if theirs is not None:  # None while xarray is being imported
            if not theirs.acquire(blocking):
                return None
            taken.callback(theirs.release)
        netcdf = sys.modules.get("netCDF4")
        if netcdf is not None and hasattr(netcdf, "set_chunk_cache"):  # a fork needs the lock, but not the library
            taken.callback(netcdf.set_chunk_cache, *netcdf.get_chunk_cache())
            netcdf.set_chunk_cache(CHUNK_CACHE)
        return taken.pop_all()


@contextlib.contextmanager
def new_hdf5(path: str | os.PathLike[str], size: int, h5py: types.ModuleType) -> Iterator[h5py.File]:
    """Context with a new h5py file; on success it becomes the file `path`.

    Args:
        path: The file.
        size: Bytes to reserve at first; the caller must reserve more space before writing more.
        h5py: The module h5py, which is an optional dependency.
    """
    with whole_file(path) as temporary, OWN:
        reserve(temporary, size)  # fails on a full disk before HDF5 writes anything
        with h5py.File(temporary, "w") as data:  # mode w releases the reserved space
            reserve(temporary, size)
            yield data
        h5py.File(temporary, "a").close()  # closing cuts off reserved space that is not needed

"""The one lock around netCDF and HDF5, which serve one thread at a time, for labkit and xarray alike.

labkit takes it wherever it uses these libraries, and gives it to xarray for the files that it opens. xarray has a lock
of its own, under which it reads values, but not attributes: LIBRARY is both locks, and the thread that holds it may
take it again. Whoever holds it reads no Dataset that the user opened, because xarray's lock cannot be taken twice.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import types
from collections.abc import Iterator
from typing import TYPE_CHECKING

import netCDF4

from labkit.io.atomic import reserve, whole_file

if TYPE_CHECKING:
    import h5py

CHUNK_CACHE = 1 << 20  # bytes per variable instead of the usual 64 MB: data are read and written only once
OWN = threading.RLock()


class LibraryLock:
    """Held while labkit uses netCDF: its own lock, that of xarray, and a small cache for variables opened meanwhile."""

    def __init__(self) -> None:
        """Start free."""
        self._depth, self._rest = 0, contextlib.ExitStack()

    def acquire(self, blocking: bool = True) -> bool:
        """Wait until no other thread uses netCDF or HDF5 through labkit, or through xarray once it is imported.

        Without `blocking` it returns False instead of waiting. xarray asks so when Python frees a file, which happens
        at any time, also while this thread is taking the lock.
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
        self.acquire()

    def __exit__(self, *error: object) -> None:
        self.release()

    def __reduce__(self) -> str:
        """A copy is the lock itself."""
        return "LIBRARY"


LIBRARY = LibraryLock()
if hasattr(os, "register_at_fork"):  # a child would wait forever for a thread that it does not have
    os.register_at_fork(before=LIBRARY.acquire, after_in_parent=LIBRARY.release, after_in_child=LIBRARY.release)


def _with_rest(blocking: bool) -> contextlib.ExitStack | None:
    """Take xarray's lock and set the cache; returns what undoes this, or None if it would have to wait."""
    with contextlib.ExitStack() as taken:
        theirs = getattr(sys.modules.get("xarray.backends.netCDF4_"), "NETCDF4_PYTHON_LOCK", None)
        if theirs is not None:  # None while xarray is being imported
            if not theirs.acquire(blocking):
                return None
            taken.callback(theirs.release)
        taken.callback(netCDF4.set_chunk_cache, *netCDF4.get_chunk_cache())
        netCDF4.set_chunk_cache(CHUNK_CACHE)
        return taken.pop_all()


@contextlib.contextmanager
def new_hdf5(path: str | os.PathLike[str], size: int, h5py: types.ModuleType) -> Iterator[h5py.File]:
    """Context with a new file of h5py, which becomes the file `path` on success.

    Args:
        path: The file.
        size: Bytes that it needs at first; more of them are to be reserved before they are written.
        h5py: The optional module.
    """
    with whole_file(path) as temporary, OWN:
        reserve(temporary, size)  # HDF5 has nothing to write yet
        with h5py.File(temporary, "w") as data:  # gives the space back
            reserve(temporary, size)
            yield data
        h5py.File(temporary, "a").close()  # cuts off reserved space that is not needed

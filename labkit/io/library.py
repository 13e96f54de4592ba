"""The one lock around netCDF and HDF5, which serve one thread at a time, for labkit and xarray alike.

labkit takes it wherever it uses these libraries. xarray itself has two locks for them, but also reads attributes
and creates variables without either; they become this one, which the thread that holds it may take again.
"""

from __future__ import annotations

import contextlib
import copyreg
import os
import sys
import threading
import types
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from labkit.io.atomic import reserve, whole_file

if TYPE_CHECKING:
    import h5py

SHARED = ("NETCDFC_LOCK", "HDF5_LOCK")  # of xarray.backends.locks
_LOCK = threading.RLock()
if hasattr(os, "register_at_fork"):  # a child would wait forever for a thread that it does not have
    os.register_at_fork(before=_LOCK.acquire, after_in_parent=_LOCK.release, after_in_child=_LOCK.release)


@contextlib.contextmanager
def netcdf_library() -> Iterator[None]:
    """Context in which no other thread uses netCDF or HDF5 through labkit, or through xarray once it is imported."""
    with _LOCK:
        _share_with_xarray()
        yield


@contextlib.contextmanager
def new_hdf5(path: str | os.PathLike[str], size: int, h5py: types.ModuleType) -> Iterator[h5py.File]:
    """Context with a new file of h5py, which becomes the file `path` on success.

    Args:
        path: The file.
        size: Bytes that it needs at first; more of them are to be reserved before they are written.
        h5py: The optional module.
    """
    with whole_file(path) as temporary, netcdf_library():
        reserve(temporary, size)  # HDF5 has nothing to write yet
        with h5py.File(temporary, "w") as data:  # gives the space back
            reserve(temporary, size)
            yield data
        h5py.File(temporary, "a").close()  # cuts off reserved space that is not needed


def _share_with_xarray() -> None:
    locks = sys.modules.get("xarray.backends.locks")
    for name in SHARED:
        theirs = getattr(locks, name, None)  # None while xarray is being imported
        if theirs is not None and theirs.lock is not _LOCK:
            with theirs.lock:  # nobody is reading
                theirs.lock = _LOCK
            copyreg.pickle(type(theirs), _reduce)


def _reduce(lock: Any) -> Any:
    """Reduce one of the shared locks to its name, so that a copy is the lock itself, and another to its token."""
    locks = sys.modules[type(lock).__module__]
    name = next((name for name in SHARED if getattr(locks, name) is lock), None)
    return name or (type(lock), (lock.token,))

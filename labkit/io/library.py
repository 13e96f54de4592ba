"""The one lock around netCDF and HDF5, which serve one thread at a time, for labkit and xarray alike.

labkit takes it wherever it uses these libraries. xarray has two locks of its own for them, but also reads attributes
and creates variables without either; they become this one, which the thread that holds it may take again.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator

_LOCK = threading.RLock()
if hasattr(os, "register_at_fork"):  # a child would wait for ever for a thread that it lacks
    os.register_at_fork(before=_LOCK.acquire, after_in_parent=_LOCK.release, after_in_child=_LOCK.release)


@contextlib.contextmanager
def netcdf_library() -> Iterator[None]:
    """Context in which no other thread uses netCDF or HDF5 through labkit, or through xarray once that is imported."""
    with _LOCK:
        _share_with_xarray()
        yield


def _share_with_xarray() -> None:
    locks = sys.modules.get("xarray.backends.locks")
    for name in ("NETCDFC_LOCK", "HDF5_LOCK"):
        theirs = getattr(locks, name, None)  # None while xarray is being imported
        if theirs is not None and theirs.lock is not _LOCK:
            with theirs.lock:  # nobody is reading
                type(theirs)._locks[theirs.token] = _LOCK  # for copies of it
                theirs.lock = _LOCK

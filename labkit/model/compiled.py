"""`@compiled`: numba without Python objects, kept on disk between two processes.

numba keeps one file per function and looks at the age of that function's own file only, so that a change in
another file would leave stale code behind. Here the stamp of every function is that of all files of this room.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numba


def _stamp():
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest(), 0


_STAMP = _stamp()


def compiled(function):
    """The function compiled at its first call; from the disk where it was compiled before."""
    dispatcher = numba.njit(function, error_model="numpy", nogil=True)
    try:
        dispatcher.enable_caching()
        dispatcher._cache._cache_file._source_stamp  # numba's own name for it: without it no file is kept
    except (RuntimeError, AttributeError):  # nowhere to write, or another numba
        return numba.njit(function, error_model="numpy", nogil=True)
    dispatcher._cache._cache_file._source_stamp = _STAMP
    return dispatcher

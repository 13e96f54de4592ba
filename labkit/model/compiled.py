"""The decorator `@compiled`: Numba in nopython mode, with a cache on disk that is shared between processes.

The stamp of every function covers all files of this package and C0, which is compiled too: a change in any of these
files invalidates the cached code (labkit.engines.kernel.compiling).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from labkit.engines.kernel.compiling import cache_on_disk, stamp_of
from labkit.sff import c0

_STAMP = stamp_of([*Path(__file__).parent.glob("*.py"), Path(c0.__file__)])


def jit(function: Callable[..., object]) -> Any:
    """Return the function, compiled at its first call or loaded from the cache on disk."""
    return cache_on_disk(function, _STAMP, error_model="numpy", nogil=True)

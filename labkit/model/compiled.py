"""`@compiled`: Numba without Python objects, kept on disk between two processes.

The stamp of every function is that of all files of this room and of C0, which it compiles: a change in one of them
leaves no stale code behind (labkit.engines.kernel.compiling).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from labkit.engines.kernel.compiling import cached, stamp_of
from labkit.sff import c0

_STAMP = stamp_of([*Path(__file__).parent.glob("*.py"), Path(c0.__file__)])


def compiled(function: Callable[..., Any]) -> Any:
    """The function compiled at its first call; from the disk where it was compiled before."""
    return cached(function, _STAMP, error_model="numpy", nogil=True)

"""The decorator `@jit`: Numba in nopython mode, with a cache on disk that is shared between processes.

The stamp of every function covers all files of this package and C0, which is compiled too: a change in any of these
files invalidates the cached code (labkit.engines.kernel.compiling).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core.registry import CPUDispatcher

from labkit.engines.kernel.compiling import CALLEE, cache_on_disk, stamp_of
from labkit.sff import c0

_STAMP = stamp_of([*Path(__file__).parent.rglob("*.py"), Path(c0.__file__)])


class Function(CPUDispatcher):
    """A compiled function whose `callee` stands for it in compiled code, without machine code of its own.

    Numba would otherwise optimise every function that another one calls, and then both of them once more.
    """

    callee: Any

    @property
    def _numba_type_(self) -> Any:
        return numba.types.Dispatcher(self.callee)


def jit(function: Callable[..., object]) -> Any:
    """Return the function, compiled at its first call or loaded from the cache on disk."""
    dispatcher: Any = cache_on_disk(function, _STAMP, error_model="numpy", nogil=True)
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    for name in ("load", "save") if file else ():
        setattr(file, name, _of_labkits_laws(getattr(file, name)))
    dispatcher.__class__, dispatcher.callee = Function, numba.njit(function, **CALLEE | {"fastmath": False})
    return dispatcher


def _of_labkits_laws(use: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a use of the cache to leave out functions compiled for a user's law, whose file has no stamp."""

    def used(key: Any, *data: object) -> Any:
        kinds = [getattr(kind, "instance_class", kind) for kind in key[0]]
        labkits = all(kind.__module__.startswith(("labkit.", "numba.")) for kind in kinds)
        return use(key, *data) if labkits else None

    return used

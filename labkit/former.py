"""Former packages, which warn that their names have moved; they will be removed in 0.4."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable


def redirect(package: str, *rooms: str) -> Callable[[str], object]:
    """Return `__getattr__` for a package whose public names have moved to others.

    Args:
        package: The former package, e.g. `labkit.dem`.
        rooms: Packages that have its names now, e.g. `grains`.
    """

    def __getattr__(name: str) -> object:
        for room in () if name.startswith("_") else rooms:
            module = importlib.import_module(f"labkit.{room}")
            if name in module.__all__:
                text = f"{package}.{name} is now labkit.{room}.{name}; {package} will be removed in labkit 0.4"
                warnings.warn(text, FutureWarning, stacklevel=2)
                return getattr(module, name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return __getattr__

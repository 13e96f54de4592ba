"""Public names of a package that are imported when they are first used."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def attach(room: str, names: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of the package `room`; `names`: public name -> submodule that has it.

    A submodule may have another name for it (`submodule:name`), or be meant itself (`submodule:`).
    """

    def __getattr__(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        module, colon, attribute = names[name].partition(":")
        found = importlib.import_module(f"{room}.{module}")
        return found if colon and not attribute else getattr(found, attribute or name)

    def __dir__() -> list[str]:
        return sorted({*vars(sys.modules[room]), *names})

    return __getattr__, __dir__, sorted(names)

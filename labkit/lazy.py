"""Public names of a package: ordinary imports for editors and type checkers, lazy imports at run time."""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from labkit.plugins import is_there


def attach(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` for a package.

    The names are those that `exports` finds, except names from plug-ins that have been deleted.
    """
    places = exports(Path(str(sys.modules[package].__file__)))
    sources = {name: place for name, place in places.items() if is_there(".".join(place))}

    def __getattr__(name: str) -> object:
        if name not in sources:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, attribute = sources[name]
        if module in (package, "labkit.plugins"):  # the name is that of a package in it
            return importlib.import_module(f"{module}.{attribute}")
        return getattr(importlib.import_module(module), attribute)

    def __dir__() -> list[str]:
        inside = vars(sys.modules[package]).items()  # without what the package imports for itself
        return sorted({name for name, it in inside if name[:2] == "__" or isinstance(it, ModuleType)} | {*sources})

    return __getattr__, __dir__, sorted(sources)


def exports(file: Path) -> dict[str, tuple[str, str]]:
    """Return the names that an `__init__.py` imports under `if TYPE_CHECKING:`, name -> (module, name there).

    The type checker and the package thus share one list. The list may contain `from labkit.grains.scene import Scene as
    Scene`, and `from labkit import paths as paths` for a submodule.
    """
    places: dict[str, tuple[str, str]] = {}
    for block in ast.parse(file.read_text()).body:
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING":
            for node in block.body:
                if isinstance(node, ast.ImportFrom):
                    places |= {alias.asname or alias.name: (node.module or "", alias.name) for alias in node.names}
    return places

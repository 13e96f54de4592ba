"""Compiles the host (labkit/engines/host) when the package is built or installed in place."""

from __future__ import annotations

import importlib.util
import sysconfig
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class HostHook(BuildHookInterface):  # type: ignore[type-arg]
    """Adds the compiled library to the wheel, which then is for one kind of computer and any Python."""

    def dependencies(self) -> list[str]:
        """Return the package with a compiler where the system has none."""
        try:
            self._build_module().compiler()
        except Exception as error:
            if type(error).__name__ != "CannotCompile":
                raise
            return ["ziglang"]
        return []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the library unless it is there."""
        library = self._build_module().build_host()
        build_data["artifacts"].append(f"/labkit/engines/host/{library.name}")
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"

    def _build_module(self) -> ModuleType:
        """Load labkit/engines/host/build.py, as labkit is not installed yet."""
        spec = importlib.util.spec_from_file_location("build_host", Path(self.root, "labkit/engines/host/build.py"))
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

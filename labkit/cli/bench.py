"""The commands that measure speed: they are in benchmarks/, outside the package, in a clone of the repository."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from labkit.errors import InputError

ROOT = Path(__file__).resolve().parents[2]

if not (ROOT / "benchmarks" / "command.py").is_file():
    raise InputError(
        "the benchmarks are in the repository of labkit, in benchmarks/, and not in the installed package: "
        "use ./lab bench in a clone"
    )
sys.path.append(str(ROOT))
importlib.import_module("benchmarks.command")

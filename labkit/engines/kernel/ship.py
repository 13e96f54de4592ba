"""Writes the machine code of labkit's laws for the wheel, so that a first start compiles nothing.

    python -m labkit.engines.kernel.ship FOLDER

compiles the functions of each law with its default parameters for each level of instructions, and stores them in
FOLDER.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from labkit.engines.fused import KINDS, needs_of
from labkit.engines.kernel import machine
from labkit.engines.kernel.blocks import compile_functions
from labkit.grains.laws import LAWS
from labkit.grains.scene import Scene

LEVELS = {"v3": "x86-64-v3", "v4": "x86-64-v4"}  # level of labkit.engines.kernel.host -> name in LLVM


def ship_level(folder: Path, level: str) -> None:
    """Compile the functions of all laws for a level into a folder; NUMBA_CPU_NAME must be set for this level."""
    machine.code_file = lambda name, stamp: folder / machine.shipped_name(name, stamp, level)
    for law in LAWS:
        for precision in KINDS:
            scene = Scene(law=law)
            compile_functions(scene.contact_law, needs_of(scene, precision))


def ship(folder: Path) -> None:
    """Compile each level in a separate process, because Numba compiles for only one processor per process."""
    folder.mkdir(parents=True, exist_ok=True)
    for level, name in LEVELS.items():
        own = {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": "-prefer-256-bit"}
        words = [sys.executable, "-P", "-m", __spec__.name, str(folder), level]
        subprocess.run(words, env={**os.environ, **own}, check=True)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        ship_level(Path(sys.argv[1]), sys.argv[2])
    else:
        ship(Path(sys.argv[1]))

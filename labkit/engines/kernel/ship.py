"""Writes the machine code of labkit's laws for wheels, so that a first start compiles nothing.

    python -m labkit.engines.kernel.ship FOLDER

compiles the functions of each law with its default parameters for each level of instructions, and stores them in
FOLDER. For browsers (labkit.engines.browser) it compiles every composition of a law's parts, because a browser
cannot compile another.
"""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from labkit.engines.fused import KINDS, needs_of
from labkit.engines.kernel import machine
from labkit.engines.kernel.blocks import Needs, law_functions, shared_functions
from labkit.grains.laws import LAWS
from labkit.grains.laws.law import ContactLaw
from labkit.grains.scene import Scene

LEVELS = {"v3": "x86-64-v3", "v4": "x86-64-v4"}  # level of labkit.engines.kernel.host -> name in LLVM
WASM = "wasm32"
FEATURES = "+simd128,+nontrapping-fptoint,+bulk-memory"  # of WebAssembly, which all browsers have
SWITCHES: dict[str, tuple[Any, ...]] = {  # parameters that decide which parts of a law act
    "friction": (0.0, 0.4),
    "rolling_friction": (0.0, 0.1),
    "twisting_friction": (0.0, 0.1),
    "beta_n": (0.0, 0.1),
    "limits": ("springs", "forces"),
}


def ship_level(folder: Path, level: str) -> None:
    """Compile the functions of all laws for a level into a folder; NUMBA_CPU_NAME must be set for this level."""
    target = web_machine() if level == WASM else machine.new_machine()
    for law, needs in compositions(level == WASM):
        for name, write, stamp in (*law_functions(law, needs), *shared_functions(needs)):
            assert stamp is not None
            symbol = machine.symbol_of(name, stamp) if level == WASM else name
            file = folder / (f"{symbol}.o" if level == WASM else machine.shipped_name(name, stamp, level))
            if not file.exists():
                code = machine.compile_code(symbol, *write(), target)
                if level == WASM:
                    file.write_bytes(code)
                else:
                    machine.write_code(file, code)


def compositions(every: bool) -> Iterator[tuple[ContactLaw, Needs]]:
    """Yield the laws with the Needs of their default parameters, or with those of every composition of their parts."""
    for name in LAWS:
        law = Scene(law=name).contact_law
        if not every:
            yield from ((law, needs_of(Scene(law=name), precision)) for precision in KINDS)
            continue
        switches = {"beta_t": (0.0,), **SWITCHES}
        names = [each for each in switches if each in law.parameters]
        for values in itertools.product(*(switches[each] for each in names)):
            scene = Scene(law=name, **dict(zip(names, values, strict=True)))
            yield from ((law, needs_of(scene, "double", clumps)) for clumps in (False, True)[: 2 - law.far])


def web_machine() -> Any:
    """Return LLVM's code generator for WebAssembly."""
    machine.llvm.initialize_all_targets()
    machine.llvm.initialize_all_asmprinters()
    target = machine.llvm.Target.from_triple(f"{WASM}-unknown-emscripten")
    return target.create_target_machine(features=FEATURES, opt=3, reloc="pic")


def ship(folder: Path, levels: tuple[str, ...] = tuple(LEVELS)) -> None:
    """Compile levels in separate processes, because Numba compiles for only one processor per process."""
    folder.mkdir(parents=True, exist_ok=True)
    for level in levels:
        target = {"NUMBA_CPU_NAME": LEVELS.get(level, "generic"), "NUMBA_CPU_FEATURES": "-prefer-256-bit"}
        words = [sys.executable, "-P", "-m", __spec__.name, str(folder), level]
        subprocess.run(words, env={**os.environ, **target}, check=True)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        ship_level(Path(sys.argv[1]), sys.argv[2])
    else:
        ship(Path(sys.argv[1]))

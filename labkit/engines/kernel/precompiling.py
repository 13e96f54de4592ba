"""On a fresh installation, compiles a part of the kernel in a second process while the first compiles the rest.

Both use the cache on disk, where each waits for what the other is compiling (labkit.engines.kernel.compiling).
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import cast

import numba
import numpy as np

from labkit.engines.kernel import sites, steps
from labkit.engines.kernel.build import kernel_of, was_compiled
from labkit.engines.kernel.compiling import Function, Untyped, to_single
from labkit.engines.kernel.layout import Arrays
from labkit.grains.scene import Scene

PROGRAM = f"import sys; sys.path[:] = sys.argv.pop().split('\\n'); from {__name__} import serve; serve(*sys.argv[1:])"
QUIET = subprocess.DEVNULL


@contextlib.contextmanager
def second_process(scene: Scene, single: bool) -> Iterator[None]:
    """Compile pieces of the kernel of a scene in a second process, until the context or this process ends.

    Nothing is started if the cache has the kernel or cannot be written, or on a single core.
    """
    law, cores = scene.contact_law, len(os.sched_getaffinity(0))
    cache = getattr(getattr(kernel_of(law, single).advance, "_cache", None), "_cache_path", "")
    with contextlib.ExitStack() as stack:
        if cores > 1 and law.labkits and os.access(cache, os.W_OK) and not was_compiled(law, single):
            words = [sys.executable, "-P", "-c", PROGRAM, scene.to_json(), str(int(single)), "\n".join(sys.path)]
            with contextlib.suppress(OSError):
                process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=QUIET, stderr=QUIET)
                stack.enter_context(process)  # closes its standard input, and waits
        yield


def serve(scene: str, single: str) -> None:
    """Compile the pieces for a scene in JSON until the standard input ends."""
    threading.Thread(target=_end_with_input, daemon=True).start()
    for function, arguments in pieces(Scene.from_json(scene), bool(int(single))):
        cast(Untyped, function).compile(tuple(map(numba.typeof, arguments)))


def _end_with_input() -> None:
    os.read(0, 1)
    os._exit(0)


def pieces(scene: Scene, single: bool) -> list[tuple[Function, tuple[object, ...]]]:
    """Return the functions to compile, in order of use, with arguments of the types that the kernel passes."""
    law, kind = scene.contact_law, np.dtype(np.float32 if single else np.float64)
    features = to_single(law.features(scene)) if single else law.features(scene)
    row, matrix, numbers, pairs = np.zeros(1), np.zeros((3, 3)), np.zeros(1, int), np.zeros((2, 1), np.uint32)
    memory, values = (np.zeros((2, 6)), np.zeros((3, 3, 3))), np.zeros((3, 3), kind)
    arrays = Arrays(*[numbers] * len(Arrays._fields))._replace(
        **dict.fromkeys(("places", "grains", "shift", "doubles", "start"), matrix),
        **dict.fromkeys(("motions", "forces", "masses", "blocks", "work"), values),
        pairs=pairs,
    )
    motion = steps.Motion(matrix, matrix, matrix, numbers, row, *memory, matrix, row, 0.0, 0.0)
    return [
        (kernel_of(law, single).branch_force, (arrays, features, row, None)),
        (steps.domain_grains, (arrays, 0, 0.0, matrix, matrix, law.local_damping(scene), values)),
        (steps.search_is_due, (motion, matrix, 0.0, row, matrix, matrix)),
        (sites.add_to_sites, (values, pairs[0], pairs[0], values[0], features.turning)),
    ]

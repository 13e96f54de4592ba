"""The kernels for one contact law.

A law is a function of scalars, `pair`, which the fused engine compiles for blocks of contacts and this engine for
threads. Its parameters belong to a State, so the states of a batch may have different values. The kernels are compiled
without the parts that are absent: `pair` gets None for them, as in the fused engine.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from labkit.engines.cuda import contacts, motion, search, servo
from labkit.engines.cuda.arrays import DeviceArray
from labkit.engines.cuda.device import DeviceKernel, kernel, on_device
from labkit.engines.kernel.compiling import Function, Version, compile_with_callees
from labkit.errors import InputError
from labkit.grains.laws import vectors
from labkit.grains.laws.law import ContactLaw
from labkit.grains.scene import Scene

READ = ("shear", "friction", "rolling", "twisting", "dashpots", "damping", "whole")  # numbers, in the order of a row

VERSION, SINGLE = Version("cuda"), Version("cuda_single", single=True)


class Kernels(NamedTuple):
    """The compiled kernels of search.py, servo.py, motion.py and contacts.py."""

    clear: DeviceKernel
    find_cells: DeviceKernel
    offsets: DeviceKernel
    sort: DeviceKernel
    count_neighbours: DeviceKernel
    arrange: DeviceKernel
    fill: DeviceKernel
    correct: DeviceKernel
    start_step: DeviceKernel
    move: DeviceKernel
    forces: DeviceKernel
    stress_of_blocks: DeviceKernel
    stress_of_states: DeviceKernel


Shape = tuple[int | bool | None, ...]


def numbers_of(scene: Scene) -> list[float | tuple[float, ...] | None]:
    """Return the values of READ for the contact law of a scene."""
    law = scene.contact_law
    values = law.features(scene)._asdict() | {"damping": law.local_damping(scene)}
    return [values[name] for name in READ]


def shape_of(scene: Scene) -> Shape:
    """Return the form of each value of READ: None if absent, True, 0 for a number, or the length of a tuple."""
    return tuple(v if v is None or v is True else len(v) if isinstance(v, tuple) else 0 for v in numbers_of(scene))


def row_of(scene: Scene) -> np.ndarray:
    """Return the numbers of READ as one row."""
    return np.concatenate([np.ravel(v) for v in numbers_of(scene) if v is not None and v is not True]).astype(float)


@functools.cache
def kernels_of(law: type[ContactLaw], shape: Shape, single: bool) -> Kernels:
    """Return the Kernels of a contact law, which are compiled at their first call.

    Args:
        law: Class of the contact law.
        shape: Form of its parameters (shape_of).
        single: True for mixed precision, in which `pair` is compiled in single precision.
    """
    names: dict[str, object] = {}
    first = 0
    for name, length in zip(READ, shape, strict=True):
        names[f"{name}_of"] = reader(length, first, np.float32 if single and name != "damping" else np.float64)
        first += length or 1 if length is not None and length is not True else 0
    names |= {"pair": law.pair, "spring": law.normal.force, "stiffness_of": law.normal.stiffness}
    if single:
        known: dict[Function, Function] = {}
        known[vectors.inverse_root] = compile_with_callees(vectors.inverse_root_single, known, SINGLE, on_device)
        for name, function in (("pair", law.pair), ("length_and_inverse", vectors.length_and_inverse)):
            names[name] = compile_with_callees(function, known, SINGLE, on_device)
        names |= {
            "overlap_of": contacts.precise_overlap,
            "as_contact": contacts.as_single,
            "KIND": np.float32,
        }
    modules = {"start_step": motion, "move": motion, "forces": contacts}
    modules |= {"correct": servo, "stress_of_blocks": contacts, "stress_of_states": contacts}
    return Kernels(*(kernel(getattr(modules.get(n, search), n), names, VERSION) for n in Kernels._fields))


Reader = Callable[[DeviceArray, int], object]


def reader(length: int | bool | None, first: int, kind: type) -> Reader:
    """Return a function of (law, s) that reads a value of READ from row s of `law`, starting at column `first`.

    Raises InputError for a tuple that is too long.
    """
    readers: dict[int | bool | None, Reader] = {
        None: lambda law, s: None,
        0: lambda law, s: kind(law[s, first]),
        2: lambda law, s: (kind(law[s, first]), kind(law[s, first + 1])),
        3: lambda law, s: (kind(law[s, first]), kind(law[s, first + 1]), kind(law[s, first + 2])),
    }
    readers[1] = lambda law, s: (kind(law[s, first]),)
    if length is True:
        return lambda law, s: True
    if length not in readers:
        raise InputError(f"a part of a contact law has {length} numbers: the engine cuda accepts at most three")
    return readers[length]

"""The kernels for one contact law.

A law is a function of scalars, `pair`, which the fused engine compiles for blocks of contacts and this engine for
threads. Its parameters are numbers of a State, so that the states of a batch may have different ones. Which features
are absent is compiled into the kernels: `pair` gets None for them, as in the fused engine.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from labkit.dem.laws.base import ContactLaw, Features
from labkit.engines.cuda import contacts, motion, search
from labkit.engines.cuda.device import kernel
from labkit.engines.kernel.compiling import Version
from labkit.errors import InputError

READ = ("constants", "friction", "rolling", "dashpots", "damping")  # Features with numbers, in the order of a row


class Kernels(NamedTuple):
    """The compiled kernels of search.py, motion.py and contacts.py."""

    clear: Any
    place: Any
    offsets: Any
    sort: Any
    count: Any
    arrange: Any
    fill: Any
    start_step: Any
    move: Any
    forces: Any
    stress_of_blocks: Any
    stress_of_states: Any


def shape_of(features: Features) -> tuple[int | None, ...]:
    """How many numbers each of READ has: None if absent, 0 for a single number, else the length of a tuple."""
    values = (getattr(features, name) for name in READ)
    return tuple(None if v is None else len(v) if isinstance(v, tuple) else 0 for v in values)


def row_of(features: Features) -> np.ndarray:
    """The numbers of READ in a row, at least one."""
    values = [np.ravel(value) for name in READ if (value := getattr(features, name)) is not None]
    return np.concatenate([*values, np.zeros(1)]).astype(float)


@functools.cache
def kernels_of(pair: Callable[..., Any], spring: Callable[..., Any], shape: tuple[int | None, ...]) -> Kernels:
    """The Kernels of a contact law with these functions, for features of this shape. Compiled at their first call.

    Raises InputError for features that are too long.
    """
    version = Version("cuda")
    readers, first = {}, 0
    for name, length in zip(READ, shape, strict=True):
        readers[f"{name}_of"] = reader(name, length, first)
        first += 0 if length is None else length or 1
    names = {"pair": pair, "spring": spring, **readers}
    modules = {"start_step": motion, "move": motion, "forces": contacts}
    modules |= {"stress_of_blocks": contacts, "stress_of_states": contacts}
    return Kernels(*(kernel(getattr(modules.get(n, search), n), names, version) for n in Kernels._fields))


def kernels_for(law: ContactLaw, features: Features) -> Kernels:
    """The Kernels of a contact law for the features of a scene."""
    return kernels_of(law.pair, law.spring, shape_of(features))


def reader(name: str, length: int | None, first: int) -> Callable[[Any, int], Any]:
    """A function of (law, s) that reads a feature from the row s of `law`, from its column `first` on."""

    def absent(law: Any, s: int) -> None:
        return None

    def number(law: Any, s: int) -> float:
        return law[s, first]

    def one(law: Any, s: int) -> tuple[float, ...]:
        return (law[s, first],)

    def two(law: Any, s: int) -> tuple[float, ...]:
        return law[s, first], law[s, first + 1]

    def three(law: Any, s: int) -> tuple[float, ...]:
        return law[s, first], law[s, first + 1], law[s, first + 2]

    def four(law: Any, s: int) -> tuple[float, ...]:
        return law[s, first], law[s, first + 1], law[s, first + 2], law[s, first + 3]

    readers = {None: absent, 0: number, 1: one, 2: two, 3: three, 4: four}
    if length not in readers:
        raise InputError(f"a contact law has {length} numbers in `{name}` of its features: the engine cuda takes four")
    return readers[length]

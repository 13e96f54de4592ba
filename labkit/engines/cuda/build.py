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

from labkit.dem.laws import vectors
from labkit.dem.laws.base import ContactLaw, Features
from labkit.dem.scene import Scene
from labkit.engines.cuda import contacts, motion, scalars, search, servo
from labkit.engines.cuda.device import device_function, kernel
from labkit.engines.kernel.compiling import Version, with_globals
from labkit.errors import InputError

READ = ("constants", "friction", "rolling", "dashpots", "damping")  # Features with numbers, in the order of a row

VERSION, SINGLE = Version("cuda"), Version("cuda_single", single=True)


class Kernels(NamedTuple):
    """The compiled kernels of search.py, servo.py, motion.py and contacts.py."""

    clear: Any
    place: Any
    offsets: Any
    sort: Any
    count: Any
    arrange: Any
    fill: Any
    correct: Any
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


def stiffness_factor(law: ContactLaw, scene: Scene) -> float | None:
    """The factor of `pair_stiffness`; None if the stiffness kn of a scene is another one, which the CPU computes."""
    defining = next(kind for kind in type(law).__mro__ if "normal_stiffness" in vars(kind))
    formula = not scene.planar and "pair_stiffness" in vars(defining)
    return law.stiffness_factor(scene) if formula else None


@functools.cache
def kernels_of(
    pair: Callable[..., Any],
    spring: Callable[..., Any],
    pair_stiffness: Callable[..., Any],
    shape: tuple[int | None, ...],
    single: bool,
) -> Kernels:
    """The Kernels of a contact law with these functions, for features of this shape. Compiled at their first call.

    single: True for mixed precision, in which `pair` is compiled in single precision. Raises InputError for features
    that are too long.
    """
    readers: dict[str, Any] = {}
    first = 0
    for name, length in zip(READ, shape, strict=True):
        kind = np.float32 if single and name != "damping" else np.float64
        readers[f"{name}_of"] = reader(name, length, first, kind)
        first += 0 if length is None else length or 1
    of_numbers = {"spring": spring, "pair_stiffness": pair_stiffness}
    names = {name: with_globals(function, {"np": scalars}, VERSION) for name, function in of_numbers.items()}
    names |= {"pair": pair, **readers}
    if single:
        known: dict[Any, Any] = {}
        known[vectors.inverse_root] = device_function(vectors.inverse_root_single, known, SINGLE)
        for name, function in (("pair", pair), ("length_and_inverse", vectors.length_and_inverse)):
            names[name] = device_function(function, known, SINGLE)
        names |= {"overlap_of": contacts.overlap_single, "rounded": contacts.rounded_single, "KIND": np.float32}
    modules = {"start_step": motion, "move": motion, "forces": contacts}
    modules |= {"correct": servo, "stress_of_blocks": contacts, "stress_of_states": contacts}
    return Kernels(*(kernel(getattr(modules.get(n, search), n), names, VERSION) for n in Kernels._fields))


def kernels_for(law: ContactLaw, features: Features, precision: str = "double") -> Kernels:
    """The Kernels of a contact law for the features of a scene."""
    return kernels_of(law.pair, law.spring, law.pair_stiffness, shape_of(features), precision == "mixed")


def reader(name: str, length: int | None, first: int, kind: type) -> Callable[[Any, int], Any]:
    """A function of (law, s) that reads a feature from the row s of `law`, from its column `first` on, as `kind`."""
    if length not in READERS:
        raise InputError(f"a contact law has {length} numbers in `{name}` of its features: the engine cuda takes four")
    return with_globals(READERS[length], {"FIRST": first, "KIND": kind}, VERSION)


FIRST, KIND = 0, np.float64  # replaced in each reader


def absent(law: Any, s: int) -> None:
    """Read a feature that is absent."""
    return None


def number(law: Any, s: int) -> float:
    """Read a number."""
    return KIND(law[s, FIRST])


def one(law: Any, s: int) -> tuple[float, ...]:
    """Read a tuple of one number."""
    return (KIND(law[s, FIRST]),)


def two(law: Any, s: int) -> tuple[float, ...]:
    """Read a tuple of two numbers."""
    return KIND(law[s, FIRST]), KIND(law[s, FIRST + 1])


def three(law: Any, s: int) -> tuple[float, ...]:
    """Read a tuple of three numbers."""
    return KIND(law[s, FIRST]), KIND(law[s, FIRST + 1]), KIND(law[s, FIRST + 2])


def four(law: Any, s: int) -> tuple[float, ...]:
    """Read a tuple of four numbers."""
    return KIND(law[s, FIRST]), KIND(law[s, FIRST + 1]), KIND(law[s, FIRST + 2]), KIND(law[s, FIRST + 3])


READERS: dict[int | None, Callable[[Any, int], Any]] = {None: absent, 0: number, 1: one, 2: two, 3: three, 4: four}

"""The functions that the host calls, as Python: the contact law, the motion of grains, cell and bodies, and the servo.

Each function takes pointers and computes a block of contacts or grains, the bodies of a domain, or a few numbers of the
cell. Order and arguments of the functions are the same as in the struct Functions in labkit/engines/host/loop.hpp.
"""

from __future__ import annotations

import contextlib
import functools
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from labkit.engines.kernel import bodies, contact_block, motion
from labkit.engines.kernel.frozen import Function, describe
from labkit.engines.kernel.layout import ARRAYS, DOUBLE_ROWS, GRAIN_ROWS, MASS_ROWS, PLACE_COLUMNS, WIDTH, WORK_ROWS
from labkit.engines.kernel.machine import PATIENCE, address_of, compiled_folder, is_kept
from labkit.engines.kernel.sources import explain_refusal, functions_of, stamp_of, try_out
from labkit.engines.kernel.tables import PointerTable
from labkit.engines.kernel.translate import Untyped, inline, load_numba, translation
from labkit.grains.laws.law import ContactLaw
from labkit.grains.laws.pair import Composition
from labkit.grains.laws.parts import write_function
from labkit.once import LOCK, once
from labkit.process.children import start_child
from labkit.process.system import number_of_cores
from labkit.servo import formula
from labkit.servo.formula import ServoPlan

PLAN = PointerTable(
    ServoPlan,
    sizes=("rows", "three", "six"),
    steps=(int, "rows"),
    **dict.fromkeys(("gradient", "given"), (float, "rows", "three", "three")),
    **dict.fromkeys(("goal", "shared"), (float, "rows", "six")),
    **dict.fromkeys(("memory", "exponential"), (int, "rows")),
    **dict.fromkeys(("controlled", "isochoric"), (int,)),
    limit=(float,),
    pull=(float, "six", "three", "three"),
    water=(float, "six"),
    kept=(float, 3, "six", "three", "three"),
    spread=(float, "three", "three", "six"),
)


class Needs(NamedTuple):
    """Everything on which the functions of a scene depend, besides its contact law.

    Args:
        law: Functions composed of the parts of the law that act in the scene.
        numbers: Parameters of these functions.
        single: True for mixed precision.
        energy: True to sum work and losses.
        damped: True if the scene has local damping.
        clumps: True if there are bodies of several spheres.
    """

    law: Composition
    numbers: Any
    single: bool
    energy: bool
    damped: bool
    clumps: bool

    @property
    def real(self) -> type[np.floating]:
        """Type of the numbers that may be single."""
        return np.float32 if self.single else np.float64

    def pattern(self, *names: str) -> str:
        """Return some fields as text, with the layout of history, losses and parameters in place of `law`."""
        return repr([self._layout() if name == "law" else getattr(self, name) for name in names])

    def _layout(self) -> tuple[object, ...]:
        numbers = [(name, np.size(value)) for name, value in self.numbers._asdict().items()]
        columns = [(name, column.size) for name, column in self.law.columns.items()]
        return columns, self.law.losses, self.law.moves, numbers

    def flat_numbers(self) -> np.ndarray:
        """Return the parameters of the law in the order in which the compiled functions read them."""
        return np.concatenate([*map(np.ravel, self.numbers), [0.0]]).astype(self.real)


Pointer: TypeAlias = object  # an address, which only Numba's carray and the view of a table read
Table: TypeAlias = Sequence[object]  # pointers
Write: TypeAlias = Callable[[], tuple[Function, Untyped]]  # returns a function for Numba, and its signature
DEPENDS = ("law", "single", "energy", "damped", "clumps")
_COMPILED: dict[tuple[object, ...], list[int]] = {}


def compile_functions(law: ContactLaw, needs: Needs) -> list[int]:
    """Return the addresses of the functions of a scene, 0 for functions that the scene does not need.

    They are compiled or loaded once per process, because an engine loads states repeatedly and the machine code of a
    law without a source file is not stored; again if a value that a user's law uses has changed, as in a notebook.
    """
    used = "" if law.labkits else describe(*functions_of(needs.law).values()).text
    key = type(law), needs.law.pair, needs.pattern(*DEPENDS), used
    if key not in _COMPILED:
        with LOCK:
            if key not in _COMPILED:
                _COMPILED[key] = _find_functions(law, needs)
    return _COMPILED[key]


def _find_functions(law: ContactLaw, needs: Needs) -> list[int]:
    if not law.labkits:
        try_out(law)
    of_law, shared = law_functions(law, needs), shared_functions(needs)
    with _compiling(shared, needs):
        with explain_refusal(law):
            addresses = [address_of(*function) for function in of_law]
        addresses += [address_of(*function) for function in reversed(shared)][::-1]
    return addresses + [0] * (len(LAW | MOTION | BODIES) - len(addresses))


def law_functions(law: ContactLaw, needs: Needs) -> list[tuple[str, Write, str | None]]:
    """Return the functions of a law, as arguments of `address_of`."""
    stamp = stamp_of(law, needs.law)
    return [
        (of.__name__[1:], functools.partial(of, law, needs), stamp and stamp + needs.pattern(*names))
        for of, names in LAW.items()
    ]


def shared_functions(needs: Needs) -> list[tuple[str, Write, str]]:
    """Return the functions that do not depend on the law, as arguments of `address_of`."""
    stamp, called = stamp_of(), MOTION | BODIES if needs.clumps else MOTION
    return [
        (of.__name__[1:], functools.partial(of, needs), f"{stamp}{needs.pattern(*names)}")
        for of, names in called.items()
    ]


@contextlib.contextmanager
def _compiling(functions: Sequence[tuple[str, object, str]], needs: Needs) -> Iterator[None]:
    """Let a second process (ahead.py) compile the functions that have no stored code, in the order of `functions`."""
    process = None
    idle = hasattr(os, "getloadavg") and max(1.0, os.getloadavg()[0]) < number_of_cores()  # otherwise it costs time
    if idle and compiled_folder() is not None and not all(is_kept(name, stamp) for name, _, stamp in functions):
        words = [sys.executable, "-P", "-m", "labkit.engines.kernel.ahead", *map(str, needs[2:])]
        with contextlib.suppress(OSError):  # raised if no further process is allowed
            process = start_child(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
        if process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):  # as if it is stopped
                process.wait(PATIENCE)
    finally:
        if process is not None:
            process.kill()
            process.wait()


def is_law_kept(law: ContactLaw, needs: Needs) -> bool:
    """Return True if the machine code of a law is stored in a file."""
    stamp = stamp_of(law, needs.law)
    return stamp is not None and is_kept("forces", stamp + needs.pattern(*LAW[_forces]))


def _kinds(needs: Needs) -> tuple[Untyped, Untyped, Untyped, Untyped]:
    """Return Numba and three pointer types: to double numbers, to numbers that may be single, and to a table."""
    numba = load_numba()
    types = numba.types
    pointers = (types.CPointer(kind) for kind in (types.float64, types.float32 if needs.single else types.float64))
    return numba, *pointers, types.CPointer(types.voidptr)


def _forces(law: ContactLaw, needs: Needs) -> tuple[Function, Untyped]:
    numba, _, reals, _ = _kinds(needs)
    carray, compute = numba.carray, _translate_law(law, needs, contact_block.block_forces)
    unpack, size, count = _unpack(needs)
    gradient_of = _gradient_of(needs)

    def forces(block: Pointer, work: Pointer, n: int, dt: float, numbers: Pointer, gradient: Pointer) -> None:
        rows, shared = carray(block, size), carray(work, WORK_ROWS * WIDTH)
        compute(rows, shared, n, dt, unpack(carray(numbers, count)), gradient_of(gradient))

    return forces, numba.void(reals, reals, numba.int64, reals.dtype, reals, reals)


def _stress(law: ContactLaw, needs: Needs) -> tuple[Function, Untyped]:
    numba, doubles, reals, _ = _kinds(needs)
    carray, compute = numba.carray, _translate_law(law, needs, contact_block.block_stress)
    unpack, size, count = _unpack(needs)
    arms = True if needs.clumps else None

    def stress(block: Pointer, work: Pointer, n: int, numbers: Pointer, sums: Pointer) -> None:
        rows, shared = carray(block, size), carray(work, WORK_ROWS * WIDTH)
        compute(rows, shared, n, unpack(carray(numbers, count)), carray(sums, 9 * WIDTH), arms)

    return stress, numba.void(reals, reals, numba.int64, reals, doubles)


def _move(needs: Needs) -> tuple[Function, Untyped]:
    numba, doubles, reals, table = _kinds(needs)
    carray, compute, double_kind = numba.carray, translation().inline(motion.move_rows), numba.float64
    wanted, before = (motion.Motion._fields.index(name) for name in ("wanted", "before"))
    damping_of, energy = _damping_of(needs), True if needs.energy else None

    def move(block: Any, masses: Any, work: Any, double: Any, n: int, dt: float, moving: Any, damping: float) -> None:
        grains, of_grains = carray(block, GRAIN_ROWS * WIDTH), carray(masses, MASS_ROWS * WIDTH)
        shared, shared2 = carray(work, WORK_ROWS * WIDTH), carray(double, DOUBLE_ROWS * WIDTH)
        L, earlier = carray(moving[wanted], (3, 3), double_kind), carray(moving[before], (3, 3), double_kind)
        rows, flow = motion.GrainRows(grains, of_grains, shared, shared2), motion.Flow(L, earlier)
        compute(rows, n, flow, dt, damping_of(damping), energy)

    return move, numba.void(doubles, reals, reals, doubles, numba.int64, numba.float64, table, numba.float64)


def _start_step(needs: Needs) -> tuple[Function, Untyped]:
    numba, _, _, table = _kinds(needs)
    correct, volume_of = translation().inline(formula.correct), translation().inline(formula.det)
    move_cell = translation().inline(motion.move_cell)
    plan_at, motion_at = _view(PLAN), _view(motion.MOTION)

    def start_step(plan: Pointer, row: int, moving: Table, dt: float) -> None:
        m = motion_at(moving)
        if row >= 0:
            correct(plan_at(plan), row, m.totals, volume_of(m.cell), dt, m.before, m.wanted, (m.rates, m.matrices))
        move_cell(m, dt)

    return start_step, numba.void(table, numba.int64, table, numba.float64)


def _search_is_due(needs: Needs) -> tuple[Function, Untyped]:
    numba, _, _, table = _kinds(needs)
    motion_at = _view(motion.MOTION)
    must_measure, compare = translation().inline(motion.must_measure), translation().inline(motion.search_is_due)

    def search_is_due(moving: Table, dt: float, speed2: float, distance2: float) -> int:
        m = motion_at(moving)
        return must_measure(m, dt, speed2) if distance2 < 0.0 else compare(m, distance2)

    return search_is_due, numba.int64(table, numba.float64, numba.float64, numba.float64)


def _distance2(needs: Needs) -> tuple[Function, Untyped]:
    numba, doubles, _, _ = _kinds(needs)
    carray, compute = numba.carray, translation().inline(motion.distance2)

    def distance2(back: Pointer, places: Pointer, start: Pointer, n: int) -> float:
        return compute(carray(back, (3, 3)), carray(places, (n, PLACE_COLUMNS)), carray(start, (n, 3)), n)

    return distance2, numba.float64(doubles, doubles, doubles, numba.int64)


def _move_bodies(needs: Needs) -> tuple[Function, Untyped]:
    numba, _, _, table = _kinds(needs)
    compute, damping_of = translation().inline(bodies.move_bodies), _damping_of(needs)
    bodies_at, arrays_at, motion_at = _views_of_bodies(needs)

    def move_bodies(rigid: Pointer, arrays: Pointer, d: int, dt: float, moving: Table, damping: float) -> None:
        compute(bodies_at(rigid), arrays_at(arrays), d, dt, motion_at(moving), damping_of(damping))

    return move_bodies, numba.void(table, table, numba.int64, numba.float64, table, numba.float64)


def _place_members(needs: Needs) -> tuple[Function, Untyped]:
    numba, _, _, table = _kinds(needs)
    compute = translation().inline(bodies.place_members)
    bodies_at, arrays_at, motion_at = _views_of_bodies(needs)

    def place_members(rigid: Pointer, arrays: Pointer, d: int, moving: Table) -> None:
        compute(bodies_at(rigid), arrays_at(arrays), d, motion_at(moving))

    return place_members, numba.void(table, table, numba.int64, table)


def _sum_forces(needs: Needs) -> tuple[Function, Untyped]:
    numba, _, reals, table = _kinds(needs)
    compute, gradient_of = translation().inline(bodies.sum_forces), _gradient_of(needs)
    bodies_at, arrays_at, _ = _views_of_bodies(needs)

    def sum_forces(rigid: Pointer, arrays: Pointer, d: int, dt: float, gradient: Pointer) -> None:
        compute(bodies_at(rigid), arrays_at(arrays), d, dt, gradient_of(gradient))

    return sum_forces, numba.void(table, table, numba.int64, numba.float64, reals)


def _fill_arms(needs: Needs) -> tuple[Function, Untyped]:
    numba, _, _, table = _kinds(needs)
    compute = translation().inline(bodies.fill_arms)
    bodies_at, arrays_at, _ = _views_of_bodies(needs)

    def fill_arms(rigid: Pointer, arrays: Pointer) -> None:
        compute(bodies_at(rigid), arrays_at(arrays))

    return fill_arms, numba.void(table, table)


# the functions in the order that the host expects, each with the Needs on which it depends
Writer: TypeAlias = Callable[..., tuple[Function, Untyped]]
LAW: dict[Writer, tuple[str, ...]] = {_forces: ("law", "single", "energy"), _stress: ("law", "single", "clumps")}
MOTION: dict[Writer, tuple[str, ...]] = {
    _move: ("single", "energy", "damped"),
    _start_step: (),
    _search_is_due: (),
    _distance2: (),
}
BODIES: dict[Writer, tuple[str, ...]] = {
    _move_bodies: ("single", "damped"),
    _place_members: ("single",),
    _sum_forces: ("single", "energy"),
    _fill_arms: ("single",),
}


@once
def _view(table: PointerTable, single: bool = False) -> Function:
    return inline(table.view(np.float32 if single else np.float64))


def _views_of_bodies(needs: Needs) -> tuple[Function, Function, Function]:
    return _view(bodies.BODIES, needs.single), _view(ARRAYS, needs.single), _view(motion.MOTION)


def _gradient_of(needs: Needs) -> Function:
    """Return a function that converts a pointer to a (3, 3) array, or returns None if no energies are summed."""
    carray = _kinds(needs)[0].carray
    return inline((lambda pointer: carray(pointer, (3, 3))) if needs.energy else (lambda pointer: None))


def _damping_of(needs: Needs) -> Function:
    return inline((lambda damping: damping) if needs.damped else (lambda damping: None))


def _translate_law(law: ContactLaw, needs: Needs, compute: Function) -> Function:
    """Return a function of labkit.engines.kernel.contact_block with the functions of a law inserted."""
    known, given = translation(needs.single), contact_block.names_of_law(law, needs.law)
    given["overlap"] = contact_block.overlap_single if needs.single else contact_block.overlap
    names = {name: known.inline(value) if callable(value) else value for name, value in given.items()}
    return known.inline(compute, names)


def _unpack(needs: Needs) -> tuple[Function, int, int]:
    """Return a function that unpacks the law's parameters, the numbers per block of contacts, and the array size."""
    first, fields = 0, []
    for value in needs.numbers:
        items = [f"x[{first + k}]" for k in range(np.size(value))]
        fields.append(f"({''.join(f'{item}, ' for item in items)})" if isinstance(value, tuple) else items[0])
        first += len(items)
    unpack = write_function(f"lambda x: Numbers({', '.join(fields)})", Numbers=needs.law.make_numbers)
    rows = 1 + sum(column.size for column in needs.law.columns.values())
    return inline(unpack), rows * WIDTH, first + 1

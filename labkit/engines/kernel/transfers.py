"""Transfers between grain records and rows of blocks, LANES records at once.

In all functions `work` is a block, and `row` is the offset within it of the first of the x components; the others
follow at offsets of WIDTH. The functions are Numba intrinsics: compiled code calls them without `code`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import cast

import numba.extending
from llvmlite import ir
from numba import types
from numba.core import cgutils

from labkit.engines.kernel.lanes import COLUMNS, DOUBLE, SINGLE, Code, Memory, Value
from labkit.engines.kernel.layout import PLACE_COLUMNS, SITE_COLUMNS, SITE_TORQUE, SITE_W


def intrinsic(write: Callable[..., None]) -> Callable[..., None]:
    """Turn a function that writes instructions into an intrinsic without a result; a decorator.

    The function gets the Code, and for each argument of the caller a Memory or an LLVM integer.
    """

    @functools.wraps(write)  # Numba reads the names of the arguments
    def define(_: Value, *kinds: Value) -> tuple[Value, Callable[..., Value]]:
        def generate(context: Value, builder: Value, __: Value, values: Value) -> Value:
            code = Code(context, builder)
            arguments = (
                Memory(code, kind, value)
                if isinstance(kind, types.Array)
                else context.cast(builder, value, kind, types.intp)
                for kind, value in zip(kinds, values, strict=True)
            )
            write(code, *arguments)
            return context.get_dummy_value()

        return types.none(*kinds), generate

    return cast("Callable[..., None]", numba.extending.intrinsic(define))


@intrinsic
def read_branches(
    code: Code, places: Memory, first: Memory, second: Memory, i: Value, work: Memory, row: Value
) -> None:
    """Read branches and sums of radii from the places of LANES pairs, first[k] and second[k] for k >= i, into rows.

    Single rows also get R^2 - d^2, computed in double precision from the sum R of the radii and the branch d.
    """
    signs = ir.Constant(ir.VectorType(DOUBLE, COLUMNS), [-1.0, -1.0, -1.0, 1.0])
    rows = []
    for chunk in places.chunks:
        a, b = (
            [code.load(places.part(side.index(i, k), 0, width=PLACE_COLUMNS)) for k in chunk]
            for side in (first, second)
        )
        rows.append(code.to_rows([code.fma(x, signs, y) for x, y in zip(a, b, strict=True)]))
    if work.kind == DOUBLE:
        for chunk, four in zip(places.chunks, rows, strict=True):
            work.put_rows(four, row, chunk.start)
        return
    for four in rows:
        squares = code.builder.fmul(four[3], four[3])
        for component in four[:3]:
            squares = code.fma(code.builder.fneg(component), component, squares)
        four.append(squares)
    work.put_rows([code.to_single(halves) for halves in zip(*rows, strict=True)], row, 0)


@intrinsic
def read_velocities(
    code: Code, motions: Memory, first: Memory, second: Memory, i: Value, work: Memory, row: Value
) -> None:
    """Read velocities of second grains relative to first grains of LANES pairs into three rows."""
    for chunk in motions.chunks:
        a, b = ([code.load(motions.part(side.index(i, k), 0)) for k in chunk] for side in (first, second))
        relative = [code.builder.fsub(y, x) for x, y in zip(a, b, strict=True)]
        work.put_rows(code.to_rows(relative)[:3], row, chunk.start)


@intrinsic
def read_spins(code: Code, motions: Memory, index: Memory, i: Value, work: Memory, row: Value) -> None:
    """Read spins and radii of LANES sites, index[k] for k >= i, into four rows."""
    for chunk in motions.chunks:
        spins = [code.load(motions.part(index.index(i, k), SITE_W)) for k in chunk]
        work.put_rows(code.to_rows(spins), row, chunk.start)


@intrinsic
def add_forces(code: Code, forces: Memory, first: Memory, second: Memory, i: Value, work: Memory, row: Value) -> None:
    """Add forces of LANES contacts to the sites of their first grains, and subtract them from those of the second."""
    for chunk in forces.chunks:
        for k, force in zip(chunk, code.to_records(work.get_rows(row, chunk.start)), strict=True):
            code.add(force, forces.part(first.index(i, k), 0))
            code.add(code.builder.fneg(force), forces.part(second.index(i, k), 0))


@intrinsic
def add_forces_and_torques(
    code: Code,
    forces: Memory,
    first: Memory,
    second: Memory,
    i: Value,
    work: Memory,
    force: Value,
    torque_a: Value,
    torque_b: Value,
) -> None:
    """Add forces and torques of LANES contacts to the sites of their grains, one contact after another.

    `force`, `torque_a` and `torque_b` are offsets of rows. The force acts on the first grain, its opposite on the
    second. Double records are changed in parts, single ones as a whole.
    """
    for chunk in forces.chunks:
        a, b = ([side.index(i, k) for k in chunk] for side in (first, second))
        on_a, turn_a, turn_b = (work.get_rows(row, chunk.start) for row in (force, torque_a, torque_b))
        if forces.kind == DOUBLE:
            records = code.to_records(on_a)
            turns = code.to_records(turn_a), code.to_records(turn_b)
            for k, record in enumerate(records):
                code.add(record, forces.part(a[k], 0))
                code.add(code.builder.fneg(record), forces.part(b[k], 0))
            for numbers, of_side in zip((a, b), turns, strict=True):
                for number, turn in zip(numbers, of_side, strict=True):
                    code.add(turn, forces.part(number, SITE_TORQUE))
        else:
            on_b = [code.builder.fneg(row) for row in on_a]
            to_a, to_b = code.to_double_records(on_a, turn_a), code.to_double_records(on_b, turn_b)
            for k in range(len(a)):
                code.add(to_a[k], forces.part(a[k], 0, 2 * COLUMNS))
                code.add(to_b[k], forces.part(b[k], 0, 2 * COLUMNS))


@intrinsic
def take_forces(code: Code, forces: Memory, first: Value, work: Memory, row: Value) -> None:
    """Read forces and torques of LANES consecutive sites into six rows, and set them to 0."""
    for chunk in forces.chunks:
        numbers = [code.plus(first, k) for k in chunk]
        halves = [
            code.to_rows([code.load(forces.part(number, column)) for number in numbers])[:3]
            for column in (0, SITE_TORQUE)
        ]
        work.put_rows([*halves[0], *halves[1]], row, chunk.start)
        for number in numbers:
            code.clear(forces.part(number, 0, 2 * COLUMNS))


@intrinsic
def take_records(code: Code, records: Memory, column: Value, first: Value, work: Memory, row: Value) -> None:
    """Read COLUMNS numbers of LANES consecutive records, from a column on, into four rows."""
    for chunk in records.chunks:
        parts = [records.part(code.plus(first, k), column, width=records.width) for k in chunk]
        work.put_rows(code.to_rows([code.load(part) for part in parts]), row, chunk.start)


@intrinsic
def put_places(code: Code, places: Memory, first: Value, doubles: Memory, row: Value) -> None:
    """Write positions and radii from four rows to LANES consecutive places."""
    for chunk in places.chunks:
        for k, record in zip(chunk, code.to_records(doubles.get_rows(row, chunk.start, COLUMNS)), strict=True):
            code.store(record, places.part(code.plus(first, k), 0, width=PLACE_COLUMNS))


@intrinsic
def put_motions(
    code: Code, motions: Memory, first: Value, grains: Memory, velocity: Value, work: Memory, spin: Value
) -> None:
    """Write velocities from three double rows, and spins and radii from four rows, to LANES consecutive sites.

    `velocity` and `spin` are offsets of rows.
    """
    for chunk in motions.chunks:
        parts = [grains.get_rows(velocity, start) for start in range(chunk.start, chunk.stop, grains.size)]
        rows = parts[0] if motions.kind == DOUBLE else [code.to_single(pair) for pair in zip(*parts, strict=True)]
        velocities, turns = code.to_records(rows), code.to_records(work.get_rows(spin, chunk.start, COLUMNS))
        for k, v, w in zip(chunk, velocities, turns, strict=True):
            code.store(code.join([v, w]), motions.part(code.plus(first, k), 0, 2 * COLUMNS))


@intrinsic
def collect_image(code: Code, forces: Memory, owner: Value, image: Value) -> None:
    """Add the force and torque on the site `image` to those on the site `owner`, and set them to 0."""
    to, source = (forces.part(site, 0, 2 * COLUMNS) for site in (owner, image))
    code.add(code.load(source), to)
    code.clear(source)


@intrinsic
def put_image(
    code: Code,
    places: Memory,
    motions: Memory,
    owner: Value,
    image: Value,
    shift: Memory,
    number: Value,
    vectors: Memory,
    drifts: Memory,
) -> None:
    """Copy a place and a motion from the site `owner` to the site `image`, shift[number] (3,) periods away.

    `vectors` (3, 4) and `drifts` (3, 8) are the records that a period in each direction adds.
    """
    builder, first = code.builder, code.builder.mul(number, code.integer(3))
    for records, periods, width in ((places, vectors, PLACE_COLUMNS), (motions, drifts, SITE_COLUMNS)):
        total = None
        for k in range(3):
            factor = builder.load(shift.number(code.plus(first, k)))
            record = code.load(periods.part(code.integer(k), 0, width, width))
            if records.kind == SINGLE:
                factor = builder.fptrunc(factor, SINGLE)
            one = builder.insert_element(ir.Constant(record.type, ir.Undefined), factor, ir.Constant(ir.IntType(32), 0))
            product = builder.fmul(code.shuffle(one, one, [0] * width), record)
            total = product if total is None else builder.fadd(total, product)
        value = code.load(records.part(owner, 0, width, width))
        code.store(builder.fadd(value, total), records.part(image, 0, width, width))


@intrinsic
def prefetch(code: Code, array: Memory, i: Value) -> None:
    """Prefetch array[i] into the cache for writing; i may lie beyond the end of the array."""
    pointer = code.builder.bitcast(array.number(i), ir.IntType(8).as_pointer())
    kind = ir.FunctionType(ir.VoidType(), [pointer.type] + 3 * [ir.IntType(32)])
    function = cgutils.get_or_insert_function(code.builder.module, kind, "llvm.prefetch.p0")
    code.builder.call(function, [pointer] + [ir.Constant(ir.IntType(32), k) for k in (1, 3, 1)])

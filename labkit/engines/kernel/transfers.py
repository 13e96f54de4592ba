"""Transfers between grain records and rows of blocks, LANES records at once.

In all functions `work` is a block, and `row` is the offset within it of the first of the x components; the others
follow at offsets of WIDTH. The functions are Numba intrinsics: the annotations are Numba's types of the caller's arrays
and numbers, and Numba supplies `typing`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numba.extending
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing import Context, Signature

from labkit.engines.kernel.lanes import COLUMNS, DOUBLE, SINGLE, Code
from labkit.engines.kernel.layout import PLACE_COLUMNS, SITE_COLUMNS, SITE_TORQUE, SITE_W

Intrinsic = tuple[Signature, Callable]  # types, and the function that generates the code


def intrinsic(function: Callable[..., Intrinsic]) -> Callable[..., None]:
    """Numba's decorator, typed as callers see it: without the argument `typing`, and without a result."""
    return cast("Callable[..., None]", numba.extending.intrinsic(function))


def _intrinsic(write: Callable[[Code], None], arguments: Sequence[Any]) -> Intrinsic:
    """Build an intrinsic without a result; write(code) generates its instructions."""

    def codegen(context, builder, signature, values):
        write(Code(context, builder, signature, values))
        return context.get_dummy_value()

    return types.none(*arguments), codegen


@intrinsic
def read_branches(
    typing: Context,
    places: types.Array,
    first: types.Array,
    second: types.Array,
    i: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Read branches and sums of radii from the places of LANES pairs, first[k] and second[k] for k >= i, into rows.

    Into single rows, also R^2 - d^2, with the sum R of the radii and the branch d in double precision.
    """

    def branches(code, chunk):
        signs = ir.Constant(ir.VectorType(DOUBLE, COLUMNS), [-1.0, -1.0, -1.0, 1.0])
        first, second = (
            [code.load(code.part(0, code.index(side, 3, k), 0, width=PLACE_COLUMNS)) for k in chunk] for side in (1, 2)
        )
        return code.to_rows([code.fma(a, signs, b) for a, b in zip(first, second, strict=True)])

    def squares(code, x, y, z, radii):
        total = code.builder.fmul(radii, radii)
        for component in (x, y, z):
            total = code.fma(code.builder.fneg(component), component, total)
        return total

    def write(code):
        chunks = list(code.chunks(0))
        rows = [branches(code, chunk) for chunk in chunks]
        if code.number(4) == DOUBLE:
            for chunk, four in zip(chunks, rows, strict=True):
                code.put_rows(four, 4, 5, chunk.start)
        else:
            both = [(*four, squares(code, *four)) for four in rows]
            code.put_rows([code.rounded(halves) for halves in zip(*both, strict=True)], 4, 5, 0)

    return _intrinsic(write, (places, first, second, i, work, row))


@intrinsic
def read_velocities(
    typing: Context,
    motions: types.Array,
    first: types.Array,
    second: types.Array,
    i: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Read velocities of second grains relative to first grains of LANES pairs into three rows."""

    def write(code):
        for chunk in code.chunks(0):
            a, b = ([code.load(code.part(0, code.index(side, 3, k), 0)) for k in chunk] for side in (1, 2))
            relative = [code.builder.fsub(y, x) for x, y in zip(a, b, strict=True)]
            code.put_rows(code.to_rows(relative)[:3], 4, 5, chunk.start)

    return _intrinsic(write, (motions, first, second, i, work, row))


@intrinsic
def read_spins(
    typing: Context,
    motions: types.Array,
    index: types.Array,
    i: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Read spins and radii of LANES sites, index[k] for k >= i, into four rows."""

    def write(code):
        for chunk in code.chunks(0):
            spins = [code.load(code.part(0, code.index(1, 2, k), SITE_W)) for k in chunk]
            code.put_rows(code.to_rows(spins), 3, 4, chunk.start)

    return _intrinsic(write, (motions, index, i, work, row))


@intrinsic
def add_forces(
    typing: Context,
    forces: types.Array,
    first: types.Array,
    second: types.Array,
    i: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Add forces of LANES contacts to the sites of their first grains, and subtract them from those of the second."""

    def write(code):
        for chunk in code.chunks(0):
            records = code.to_records(code.get_rows(4, 5, chunk.start))
            for k, force in zip(chunk, records, strict=True):
                code.add(force, code.part(0, code.index(1, 3, k), 0))
                code.add(code.builder.fneg(force), code.part(0, code.index(2, 3, k), 0))

    return _intrinsic(write, (forces, first, second, i, work, row))


@intrinsic
def add_forces_and_torques(
    typing: Context,
    forces: types.Array,
    first: types.Array,
    second: types.Array,
    i: types.Integer,
    work: types.Array,
    force: types.Integer,
    torque_a: types.Integer,
    torque_b: types.Integer,
) -> Intrinsic:
    """Add forces and torques of LANES contacts to the sites of their grains, one contact after another.

    force, torque_a, torque_b: offsets of the rows; the force acts on the first grain, its opposite on the second.
    Double records are changed in parts, single ones as a whole.
    """

    def on_doubles(code, a, b, on_a, turn_a, turn_b):
        on_a, turn_a, turn_b = (code.to_records(rows) for rows in (on_a, turn_a, turn_b))
        for k in range(len(a)):
            code.add(on_a[k], code.part(0, a[k], 0))
            code.add(code.builder.fneg(on_a[k]), code.part(0, b[k], 0))
        for numbers, turns in ((a, turn_a), (b, turn_b)):
            for number, turn in zip(numbers, turns, strict=True):
                code.add(turn, code.part(0, number, SITE_TORQUE))

    def on_singles(code, a, b, on_a, turn_a, turn_b):
        on_b = [code.builder.fneg(row) for row in on_a]
        to_a, to_b = code.to_double_records(on_a, turn_a), code.to_double_records(on_b, turn_b)
        for k in range(len(a)):
            code.add(to_a[k], code.part(0, a[k], 0, 2 * COLUMNS))
            code.add(to_b[k], code.part(0, b[k], 0, 2 * COLUMNS))

    def write(code):
        add = on_doubles if code.number(0) == DOUBLE else on_singles
        for chunk in code.chunks(0):
            a, b = ([code.index(side, 3, k) for k in chunk] for side in (1, 2))
            add(code, a, b, *(code.get_rows(4, row, chunk.start) for row in (5, 6, 7)))

    return _intrinsic(write, (forces, first, second, i, work, force, torque_a, torque_b))


@intrinsic
def take_forces(
    typing: Context, forces: types.Array, first: types.Integer, work: types.Array, row: types.Integer
) -> Intrinsic:
    """Read forces and torques of LANES consecutive sites into six rows, and set them to 0."""

    def write(code):
        for chunk in code.chunks(0):
            numbers = [code.following(1, k) for k in chunk]
            halves = [
                code.to_rows([code.load(code.part(0, number, column)) for number in numbers])[:3]
                for column in (0, SITE_TORQUE)
            ]
            code.put_rows([*halves[0], *halves[1]], 2, 3, chunk.start)
            for number in numbers:
                whole = code.part(0, number, 0, 2 * COLUMNS)
                code.store(ir.Constant(whole.type.pointee, None), whole)

    return _intrinsic(write, (forces, first, work, row))


@intrinsic
def take_records(
    typing: Context,
    records: types.Array,
    column: types.Integer,
    first: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Read COLUMNS numbers of LANES consecutive records, from a column on, into four rows."""

    def write(code):
        for chunk in code.chunks(0):
            four = code.to_rows([code.load(code.variable_part(0, code.following(2, k), 1)) for k in chunk])
            code.put_rows(four, 3, 4, chunk.start)

    return _intrinsic(write, (records, column, first, work, row))


@intrinsic
def put_places(
    typing: Context, places: types.Array, first: types.Integer, doubles: types.Array, row: types.Integer
) -> Intrinsic:
    """Write positions and radii from four rows to LANES consecutive places."""

    def write(code):
        for chunk in code.chunks(0):
            records = code.to_records(code.get_rows(2, 3, chunk.start, COLUMNS))
            for k, record in zip(chunk, records, strict=True):
                code.store(record, code.part(0, code.following(1, k), 0, width=PLACE_COLUMNS))

    return _intrinsic(write, (places, first, doubles, row))


@intrinsic
def put_motions(
    typing: Context,
    motions: types.Array,
    first: types.Integer,
    grains: types.Array,
    velocity: types.Integer,
    work: types.Array,
    spin: types.Integer,
) -> Intrinsic:
    """Write velocities from three double rows, and spins and radii from four rows, to LANES consecutive sites.

    velocity, spin: offsets of the rows.
    """

    def write(code):
        for chunk in code.chunks(0):
            parts = [code.get_rows(2, 3, start) for start in range(chunk.start, chunk.stop, 8)]
            rows = parts[0] if code.number(0) == DOUBLE else [code.rounded(pair) for pair in zip(*parts, strict=True)]
            velocities, turns = code.to_records(rows), code.to_records(code.get_rows(4, 5, chunk.start, COLUMNS))
            for k, v, w in zip(chunk, velocities, turns, strict=True):
                code.store(code.joined([v, w]), code.part(0, code.following(1, k), 0, 2 * COLUMNS))

    return _intrinsic(write, (motions, first, grains, velocity, work, spin))


@intrinsic
def collect_image(typing: Context, forces: types.Array, owner: types.Integer, image: types.Integer) -> Intrinsic:
    """Add the force and torque on the site `image` to those on the site `owner`, and set them to 0."""

    def write(code):
        to, source = (code.part(0, code.integer(k), 0, 2 * COLUMNS) for k in (1, 2))
        code.add(code.load(source), to)
        code.store(ir.Constant(source.type.pointee, None), source)

    return _intrinsic(write, (forces, owner, image))


@intrinsic
def put_image(
    typing: Context,
    places: types.Array,
    motions: types.Array,
    owner: types.Integer,
    image: types.Integer,
    shift: types.Array,
    number: types.Integer,
    vectors: types.Array,
    drifts: types.Array,
) -> Intrinsic:
    """Copy a place and a motion from the site `owner` to the site `image`, shift[number] (3,) periods away.

    vectors (3, 4), drifts (3, 8): the records that a period in each direction adds.
    """

    def copy(code, records, periods, width):
        builder, total = code.builder, None
        first = builder.mul(code.integer(5), ir.Constant(ir.IntType(64), 3))
        for k in range(3):
            column = ir.Constant(ir.IntType(64), k)
            factor = builder.load(builder.gep(code.array(4).data, [builder.add(first, column)]))
            record = code.load(code.part(periods, column, 0, width, width))
            if code.number(records) == SINGLE:
                factor = builder.fptrunc(factor, SINGLE)
            one = builder.insert_element(ir.Constant(record.type, ir.Undefined), factor, ir.Constant(ir.IntType(32), 0))
            product = builder.fmul(code.shuffle(one, one, [0] * width), record)
            total = product if total is None else builder.fadd(total, product)
        value = code.load(code.part(records, code.integer(2), 0, width, width))
        code.store(builder.fadd(value, total), code.part(records, code.integer(3), 0, width, width))

    def write(code):
        copy(code, 0, 6, PLACE_COLUMNS)
        copy(code, 1, 7, SITE_COLUMNS)

    return _intrinsic(write, (places, motions, owner, image, shift, number, vectors, drifts))


@intrinsic
def prefetch(typing: Context, array: types.Array, i: types.Integer) -> Intrinsic:
    """Prefetch array[i] into the cache for writing; i may lie beyond the end of the array."""

    def write(code):
        pointer = code.pointer(code.array(0).data, code.integer(1), ir.IntType(8))
        kind = ir.FunctionType(ir.VoidType(), [pointer.type] + 3 * [ir.IntType(32)])
        function = cgutils.get_or_insert_function(code.builder.module, kind, "llvm.prefetch.p0")
        code.builder.call(function, [pointer] + [ir.Constant(ir.IntType(32), k) for k in (1, 3, 1)])

    return _intrinsic(write, (array, i))

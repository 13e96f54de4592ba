"""Transfers between grain records and rows of blocks, eight records of three numbers at once.

They use loads, shuffles and stores of whole vectors, which LLVM does not generate from loops.

A vector takes COLUMNS numbers of a grain record, of which the last is unused. In all functions `work` is a block, and
`row` is the offset within it of the first of eight x components; the y and z components follow at offsets of WIDTH and
2 WIDTH from there. The functions are Numba intrinsics: the annotations are Numba's types of the caller's arrays and
numbers, and Numba supplies `typing`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numba.extending
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing import Context, Signature

from labkit.engines.kernel.layout import LANES, WIDTH

Intrinsic = tuple[Signature, Callable]  # types, and the function that generates the code

COLUMNS = 4
DOUBLE = ir.DoubleType()
RECORD, ROW = ir.VectorType(DOUBLE, COLUMNS), ir.VectorType(DOUBLE, LANES)
LOW, HIGH = (0, 8, 2, 10, 4, 12, 6, 14), (1, 9, 3, 11, 5, 13, 7, 15)  # even and odd lanes of two vectors
EVEN, ODD = (0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15)  # even and odd pairs of lanes


class _Code:
    """Generates the LLVM instructions of one call of an intrinsic; methods take arguments by position."""

    def __init__(self, context: Any, builder: Any, signature: Signature, arguments: Sequence[Any]) -> None:
        self.context, self.builder = context, builder
        self.types, self.arguments = signature.args, arguments

    def array(self, k):
        return self.context.make_array(self.types[k])(self.context, self.builder, self.arguments[k])

    def integer(self, k):
        return self.context.cast(self.builder, self.arguments[k], self.types[k], types.intp)

    def pointer(self, data, offset, kind):
        return self.builder.bitcast(self.builder.gep(data, [offset]), kind.as_pointer())

    def shuffle(self, a, b, lanes):
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
        return self.builder.shuffle_vector(a, b, mask)

    def indexed(self, records, column, index, first):
        """Pointers to the eight records whose indices are in the array `index`, starting at `first`."""
        data, start = self.array(index).data, self.integer(first)
        for k in range(LANES):
            entry = self.builder.gep(data, [self.builder.add(start, ir.Constant(start.type, k))])
            yield self.record(records, column, self.builder.zext(self.builder.load(entry), start.type))

    def consecutive(self, records, column, first):
        start = self.integer(first)
        for k in range(LANES):
            yield self.record(records, column, self.builder.add(start, ir.Constant(start.type, k)))

    def record(self, records, column, number):
        array, columns = self.array(records), self.types[records]
        width = cgutils.unpack_tuple(self.builder, array.shape, columns.ndim)[1]
        return self.pointer(array.data, self.builder.add(self.builder.mul(number, width), self.integer(column)), RECORD)

    def rows(self, work, row):
        """Pointers to the rows of x, y and z."""
        data, first = self.array(work).data, self.integer(row)
        for k in range(3):
            yield self.pointer(data, self.builder.add(first, ir.Constant(first.type, k * WIDTH)), ROW)

    def load(self, pointer):
        return self.builder.load(pointer, align=8)

    def store(self, value, pointer):
        self.builder.store(value, pointer, align=8)

    def to_rows(self, records, work, row):
        """Store eight records as rows."""
        halves = [self.shuffle(records[k], records[k + 4], range(8)) for k in range(4)]
        low = [self.shuffle(halves[k], halves[k + 1], LOW) for k in (0, 2)]
        high = [self.shuffle(halves[k], halves[k + 1], HIGH) for k in (0, 2)]
        x, y, z = self.shuffle(*low, EVEN), self.shuffle(*high, EVEN), self.shuffle(*low, ODD)
        for value, pointer in zip((x, y, z), self.rows(work, row), strict=True):
            self.store(value, pointer)

    def to_records(self, work, row):
        """Convert three rows to eight records; the unused number is 0."""
        x, y, z = (self.load(pointer) for pointer in self.rows(work, row))
        nothing = ir.Constant(ROW, None)
        records = [None] * LANES
        for k, lanes in enumerate((LOW, HIGH)):
            xy, z0 = self.shuffle(x, y, lanes), self.shuffle(z, nothing, lanes)
            for j, pairs in enumerate((EVEN, ODD)):
                both = self.shuffle(xy, z0, pairs)
                records[k + 2 * j] = self.shuffle(both, both, range(4))
                records[k + 2 * j + 4] = self.shuffle(both, both, range(4, 8))
        return records


def intrinsic(function: Callable[..., Intrinsic]) -> Callable[..., None]:
    """Numba's decorator, typed as callers see it: without the argument `typing`, and without a result."""
    return cast("Callable[..., None]", numba.extending.intrinsic(function))


def _intrinsic(write: Callable[[_Code], None], arguments: Sequence[Any]) -> Intrinsic:
    """Build an intrinsic without a result; write(code) generates its instructions."""

    def codegen(context, builder, signature, values):
        write(_Code(context, builder, signature, values))
        return context.get_dummy_value()

    return types.none(*arguments), codegen


@intrinsic
def read(
    typing: Context,
    records: types.Array,
    column: types.Integer,
    index: types.Array,
    i: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Read the records index[i] to index[i + 7], starting at a column, into rows."""

    def write(code):
        code.to_rows([code.load(p) for p in code.indexed(0, 1, 2, 3)], 4, 5)

    return _intrinsic(write, (records, column, index, i, work, row))


@intrinsic
def read_difference(
    typing: Context,
    records: types.Array,
    column: types.Integer,
    index: types.Array,
    other: types.Array,
    i: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Read the differences of records, other[k] minus index[k] for k = i to i + 7, into rows."""

    def write(code):
        first = [code.load(p) for p in code.indexed(0, 1, 2, 4)]
        second = [code.load(p) for p in code.indexed(0, 1, 3, 4)]
        code.to_rows([code.builder.fsub(b, a) for a, b in zip(first, second, strict=True)], 5, 6)

    return _intrinsic(write, (records, column, index, other, i, work, row))


@intrinsic
def add(
    typing: Context,
    records: types.Array,
    column: types.Integer,
    index: types.Array,
    i: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Add rows to the records index[i] to index[i + 7], one after another."""

    def write(code):
        for value, p in zip(code.to_records(4, 5), code.indexed(0, 1, 2, 3), strict=True):
            code.store(code.builder.fadd(code.load(p), value), p)

    return _intrinsic(write, (records, column, index, i, work, row))


@intrinsic
def add_opposite(
    typing: Context,
    records: types.Array,
    column: types.Integer,
    index: types.Array,
    other: types.Array,
    i: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Add rows to the records index[k] and subtract them from other[k] for k = i to i + 7, one after another."""

    def write(code):
        both = zip(code.to_records(5, 6), code.indexed(0, 1, 2, 4), code.indexed(0, 1, 3, 4), strict=True)
        for value, p, q in both:
            code.store(code.builder.fadd(code.load(p), value), p)
            code.store(code.builder.fsub(code.load(q), value), q)

    return _intrinsic(write, (records, column, index, other, i, work, row))


@intrinsic
def take(
    typing: Context,
    records: types.Array,
    column: types.Integer,
    first: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Read eight consecutive records into rows and set them to 0."""

    def write(code):
        pointers = list(code.consecutive(0, 1, 2))
        code.to_rows([code.load(p) for p in pointers], 3, 4)
        for p in pointers:
            code.store(ir.Constant(RECORD, None), p)

    return _intrinsic(write, (records, column, first, work, row))


@intrinsic
def put(
    typing: Context,
    records: types.Array,
    column: types.Integer,
    first: types.Integer,
    work: types.Array,
    row: types.Integer,
) -> Intrinsic:
    """Write rows to eight consecutive records."""

    def write(code):
        for value, p in zip(code.to_records(3, 4), code.consecutive(0, 1, 2), strict=True):
            code.store(value, p)

    return _intrinsic(write, (records, column, first, work, row))


@intrinsic
def prefetch(typing: Context, array: types.Array, i: types.Integer) -> Intrinsic:
    """Prefetch array[i] into the cache for writing; i may lie beyond the end of the array."""

    def write(code):
        pointer = code.pointer(code.array(0).data, code.integer(1), ir.IntType(8))
        kind = ir.FunctionType(ir.VoidType(), [pointer.type] + 3 * [ir.IntType(32)])
        function = cgutils.get_or_insert_function(code.builder.module, kind, "llvm.prefetch.p0")
        code.builder.call(function, [pointer] + [ir.Constant(ir.IntType(32), k) for k in (1, 3, 1)])

    return _intrinsic(write, (array, i))

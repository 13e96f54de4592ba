"""Instructions for whole vectors that LLVM does not generate from loops: loads, shuffles and stores.

They convert between records of grains and rows of blocks, LANES records at once, for the functions of transfers.py;
with loops instead, a time step takes 1.4 to 3 times as long. A vector in a grain record occupies COLUMNS numbers: three
components and one more. The types of the arrays determine whether records and rows are double or single.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

from llvmlite import ir
from numba import types
from numba.core import cgutils

from labkit.engines.kernel.layout import LANES, SITE_COLUMNS, WIDTH

Value: TypeAlias = Any  # a value, a type or a builder of LLVM or Numba, which have no types

COLUMNS = 4
DOUBLE, SINGLE, INTEGER = ir.DoubleType(), ir.FloatType(), ir.IntType(64)
BYTES = {DOUBLE: 8, SINGLE: 4}
REGISTER = 64  # bytes of a vector register

# Shuffles that exchange rows and columns in each group of COLUMNS numbers of four registers: two rounds, each with the
# first and the last numbers of pairs of registers; and the order of the results. Those for doubles, two groups per
# register, stay within 128 bits or move whole 128 bits, which is fastest.
_GROUPS = range(0, 16, COLUMNS)
EXCHANGE: dict[Value, tuple[Sequence[int], ...]] = {
    DOUBLE: (
        (0, 8, 2, 10, 4, 12, 6, 14),
        (1, 9, 3, 11, 5, 13, 7, 15),
        (0, 1, 8, 9, 4, 5, 12, 13),
        (2, 3, 10, 11, 6, 7, 14, 15),
        (0, 2, 1, 3),
    ),
    SINGLE: (
        [g + k for g in _GROUPS for k in (0, 16, 1, 17)],
        [g + k for g in _GROUPS for k in (2, 18, 3, 19)],
        [g + k for g in _GROUPS for k in (0, 1, 16, 17)],
        [g + k for g in _GROUPS for k in (2, 3, 18, 19)],
        (0, 1, 2, 3),
    ),
}


class Code:
    """Generates LLVM instructions for vectors, from context and builder of Numba's code-generating function."""

    def __init__(self, context: Value, builder: Value) -> None:
        """Start without instructions."""
        self.context, self.builder = context, builder

    def integer(self, value: Value) -> Value:
        """Convert a Python integer to LLVM; an LLVM integer is returned as it is."""
        return ir.Constant(INTEGER, value) if isinstance(value, int) else value

    def plus(self, a: Value, b: Value) -> Value:
        """Sum of two integers."""
        return self.builder.add(self.integer(a), self.integer(b))

    def shuffle(self, a: Value, b: Value, lanes: Sequence[int]) -> Value:
        """Vector of the numbers of a and b at the indices `lanes`, which count on from a to b."""
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
        return self.builder.shuffle_vector(a, b, mask)

    def join(self, parts: Sequence[Value]) -> Value:
        """Join vectors, whose number is a power of two."""
        while len(parts) > 1:
            lanes = range(2 * parts[0].type.count)
            parts = [self.shuffle(a, b, lanes) for a, b in zip(parts[::2], parts[1::2], strict=True)]
        return parts[0]

    def load(self, pointer: Value) -> Value:
        """Load a vector."""
        return self.builder.load(pointer, align=BYTES[pointer.type.pointee.element])

    def store(self, value: Value, pointer: Value) -> None:
        """Store a vector."""
        self.builder.store(value, pointer, align=BYTES[value.type.element])

    def clear(self, pointer: Value) -> None:
        """Set a vector in memory to 0."""
        self.store(ir.Constant(pointer.type.pointee, None), pointer)

    def add(self, value: Value, pointer: Value) -> None:
        """Add a vector to one in memory."""
        self.store(self.builder.fadd(self.load(pointer), value), pointer)

    def fma(self, a: Value, b: Value, c: Value) -> Value:
        """a b + c, rounded once; vectors of doubles."""
        kind = ir.FunctionType(a.type, 3 * [a.type])
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.fma.v{a.type.count}f64")
        return self.builder.call(function, [a, b, c])

    def to_single(self, doubles: Sequence[Value]) -> Value:
        """Round two registers of doubles to one register of single numbers."""
        kind = ir.VectorType(SINGLE, doubles[0].type.count)
        return self.join([self.builder.fptrunc(value, kind) for value in doubles])

    def exchange(self, four: Sequence[Value]) -> list[Value]:
        """Exchange rows and columns in each group of COLUMNS numbers of four registers."""
        first, last, front, back, order = EXCHANGE[four[0].type.element]
        halves = [[self.shuffle(four[k], four[k + 1], lanes) for k in (0, 2)] for lanes in (first, last)]
        results = [self.shuffle(a, b, lanes) for a, b in halves for lanes in (front, back)]
        return [results[k] for k in order]

    def to_rows(self, records: Sequence[Value]) -> list[Value]:
        """Four rows of as many records of COLUMNS numbers as a register has numbers."""
        return self.exchange([self.join(records[k::COLUMNS]) for k in range(COLUMNS)])

    def to_registers(self, rows: Sequence[Value]) -> list[Value]:
        """Four registers of records from four rows; three rows give records that end with 0."""
        return self.exchange([*rows, *[ir.Constant(rows[0].type, None)] * (COLUMNS - len(rows))])

    def to_records(self, rows: Sequence[Value]) -> list[Value]:
        """The inverse of to_rows; three rows give records that end with 0."""
        registers = self.to_registers(rows)
        size = rows[0].type.count
        return [
            self.shuffle(registers[k % COLUMNS], registers[k % COLUMNS], range(k - k % COLUMNS, k - k % COLUMNS + 4))
            for k in range(size)
        ]

    def to_double_records(self, first: Sequence[Value], second: Sequence[Value]) -> list[Value]:
        """Records of 2 COLUMNS numbers, each half from three rows."""
        halves = self.to_registers(first), self.to_registers(second)
        size = first[0].type.count
        records = [None] * size
        for k, (a, b) in enumerate(zip(*halves, strict=True)):
            for g in range(0, size, 2 * COLUMNS):
                lanes = [n + m + j for n in (g, g + COLUMNS) for m in (0, size) for j in range(COLUMNS)]
                pair = self.shuffle(a, b, lanes)
                records[k + g] = self.shuffle(pair, pair, range(2 * COLUMNS))
                records[k + g + COLUMNS] = self.shuffle(pair, pair, range(2 * COLUMNS, 4 * COLUMNS))
        return records


class Memory:
    """An array of records, rows or indices; `kind` is the type of its numbers, `chunks` the records per register."""

    def __init__(self, code: Code, kind: Value, value: Value) -> None:
        """Take an argument of Numba's code-generating function."""
        array = code.context.make_array(kind)(code.context, code.builder, value)
        self._code, self._data, self._shape = code, array.data, array.shape
        self.kind = SINGLE if kind.dtype == types.float32 else DOUBLE
        self.size = REGISTER // BYTES[self.kind]
        self.chunks = [range(start, start + self.size) for start in range(0, LANES, self.size)]

    @property
    def width(self) -> Value:
        """Numbers per record."""
        return cgutils.unpack_tuple(self._code.builder, self._shape, 2)[1]

    def number(self, place: Value) -> Value:
        """Pointer to one number."""
        return self._code.builder.gep(self._data, [place])

    def index(self, first: Value, k: int) -> Value:
        """The index stored at place first + k."""
        return self._code.builder.zext(self._code.builder.load(self.number(self._code.plus(first, k))), INTEGER)

    def vector(self, place: Value, count: int) -> Value:
        """Pointer to `count` numbers, starting at a place."""
        return self._code.builder.bitcast(self.number(place), ir.VectorType(self.kind, count).as_pointer())

    def part(self, number: Value, column: Value, count: int = COLUMNS, width: Value = SITE_COLUMNS) -> Value:
        """Pointer to `count` numbers of a record of `width` numbers, starting at a column."""
        place = self._code.builder.mul(number, self._code.integer(width))
        return self.vector(self._code.plus(place, column), count)

    def rows(self, row: Value, start: int, count: int) -> list[Value]:
        """Pointers to `count` rows, each starting at number `start`."""
        return [self.vector(self._code.plus(row, k * WIDTH + start), self.size) for k in range(count)]

    def get_rows(self, row: Value, start: int, count: int = 3) -> list[Value]:
        """Load rows, each starting at number `start`."""
        return [self._code.load(pointer) for pointer in self.rows(row, start, count)]

    def put_rows(self, rows: Sequence[Value], row: Value, start: int) -> None:
        """Store rows, each starting at number `start`."""
        for value, pointer in zip(rows, self.rows(row, start, len(rows)), strict=True):
            self._code.store(value, pointer)

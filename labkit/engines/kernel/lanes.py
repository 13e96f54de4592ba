"""Instructions for whole vectors, which LLVM does not generate from loops: loads, shuffles and stores.

They convert between records of grains and rows of blocks, LANES records at once; `Code` generates them for the
functions of transfers.py. A vector of a grain record takes COLUMNS numbers: three components and one more. Records and
rows are double or single, as the types of the arrays say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing import Signature

from labkit.engines.kernel.layout import LANES, SITE_COLUMNS, WIDTH

Value = Any  # of LLVM

COLUMNS = 4
DOUBLE, SINGLE = ir.DoubleType(), ir.FloatType()
BYTES = {DOUBLE: 8, SINGLE: 4}
REGISTER = 64  # bytes of a vector register

# Shuffles that exchange rows and columns in each group of COLUMNS numbers of four registers: two rounds, each with the
# first and the last numbers of pairs of registers; and the order of the results. Those for doubles, two groups per
# register, stay within 128 bits or move whole 128 bits, which is fastest.
_GROUPS = range(0, 16, COLUMNS)
EXCHANGE: dict[Any, tuple[Sequence[int], ...]] = {
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
    """Generates the LLVM instructions of one call of an intrinsic; methods take arguments by position."""

    def __init__(self, context: Any, builder: Any, signature: Signature, arguments: Sequence[Any]) -> None:
        """The arguments of Numba's function that generates code."""
        self.context, self.builder = context, builder
        self.types, self.arguments = signature.args, arguments

    def array(self, k: int) -> Any:
        """The array that is the k-th argument, as Numba's structure."""
        return self.context.make_array(self.types[k])(self.context, self.builder, self.arguments[k])

    def integer(self, k: int) -> Value:
        """The integer that is the k-th argument."""
        return self.context.cast(self.builder, self.arguments[k], self.types[k], types.intp)

    def number(self, k: int) -> ir.Type:
        """Type of the numbers in an array."""
        return SINGLE if self.types[k].dtype == types.float32 else DOUBLE

    def chunks(self, k: int) -> Iterator[range]:
        """Records that fill one register of the numbers of an array, in turn."""
        size = REGISTER // BYTES[self.number(k)]
        return (range(start, start + size) for start in range(0, LANES, size))

    def pointer(self, data: Value, offset: Value, kind: ir.Type) -> Value:
        """Pointer to a vector of this type, `offset` numbers from the start of the data."""
        return self.builder.bitcast(self.builder.gep(data, [offset]), kind.as_pointer())

    def shuffle(self, a: Value, b: Value, lanes: Sequence[int]) -> Value:
        """Vector of these numbers of a, or of b after those of a."""
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
        return self.builder.shuffle_vector(a, b, mask)

    def joined(self, parts: Sequence[Value]) -> Value:
        """One vector of several, whose number is a power of two."""
        while len(parts) > 1:
            lanes = range(2 * parts[0].type.count)
            parts = [self.shuffle(a, b, lanes) for a, b in zip(parts[::2], parts[1::2], strict=True)]
        return parts[0]

    def index(self, indices: int, first: int, k: int) -> Value:
        """The index indices[first + k]; arguments by position."""
        entry = self.builder.gep(
            self.array(indices).data, [self.builder.add(self.integer(first), ir.Constant(ir.IntType(64), k))]
        )
        return self.builder.zext(self.builder.load(entry), ir.IntType(64))

    def following(self, first: int, k: int) -> Value:
        """The integer first + k."""
        return self.builder.add(self.integer(first), ir.Constant(ir.IntType(64), k))

    def part(self, records: int, number: Value, column: int, count: int = COLUMNS, width: int = SITE_COLUMNS) -> Value:
        """Pointer to `count` numbers of a record, from a column on; width: numbers per record, here a constant."""
        builder = self.builder
        place = builder.mul(number, ir.Constant(ir.IntType(64), width))
        place = builder.add(place, ir.Constant(ir.IntType(64), column))
        return self.pointer(self.array(records).data, place, ir.VectorType(self.number(records), count))

    def variable_part(self, records: int, number: Value, column: int) -> Value:
        """Pointer to COLUMNS numbers of a record, from the column that an argument gives."""
        width = cgutils.unpack_tuple(self.builder, self.array(records).shape, 2)[1]
        place = self.builder.add(self.builder.mul(number, width), self.integer(column))
        return self.pointer(self.array(records).data, place, ir.VectorType(self.number(records), COLUMNS))

    def rows(self, work: int, row: int, start: int, count: int) -> Iterator[Value]:
        """Pointers to `count` rows, each from the number `start` on."""
        kind = ir.VectorType(self.number(work), REGISTER // BYTES[self.number(work)])
        for k in range(count):
            offset = self.builder.add(self.integer(row), ir.Constant(ir.IntType(64), k * WIDTH + start))
            yield self.pointer(self.array(work).data, offset, kind)

    def load(self, pointer: Value) -> Value:
        """Load a vector."""
        return self.builder.load(pointer, align=BYTES[pointer.type.pointee.element])

    def store(self, value: Value, pointer: Value) -> None:
        """Store a vector."""
        self.builder.store(value, pointer, align=BYTES[value.type.element])

    def add(self, value: Value, pointer: Value) -> None:
        """Add a vector to one in memory."""
        self.store(self.builder.fadd(self.load(pointer), value), pointer)

    def fma(self, a: Value, b: Value, c: Value) -> Value:
        """a b + c, rounded once; vectors of doubles."""
        kind = ir.FunctionType(a.type, 3 * [a.type])
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.fma.v{a.type.count}f64")
        return self.builder.call(function, [a, b, c])

    def exchanged(self, four: Sequence[Value]) -> list[Value]:
        """Exchange rows and columns in each group of COLUMNS numbers of four registers."""
        first, last, front, back, order = EXCHANGE[four[0].type.element]
        halves = [[self.shuffle(four[k], four[k + 1], lanes) for k in (0, 2)] for lanes in (first, last)]
        results = [self.shuffle(a, b, lanes) for a, b in halves for lanes in (front, back)]
        return [results[k] for k in order]

    def to_rows(self, records: Sequence[Value]) -> list[Value]:
        """Four rows of as many records of COLUMNS numbers as a register has numbers."""
        return self.exchanged([self.joined(records[k::COLUMNS]) for k in range(COLUMNS)])

    def to_registers(self, rows: Sequence[Value]) -> list[Value]:
        """Four registers of records from four rows; three rows give records that end with 0."""
        return self.exchanged([*rows, *[ir.Constant(rows[0].type, None)] * (COLUMNS - len(rows))])

    def to_double_records(self, first: Sequence[Value], second: Sequence[Value]) -> list[Value]:
        """Records of twice COLUMNS numbers from three rows for each half."""
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

    def to_records(self, rows: Sequence[Value]) -> list[Value]:
        """The inverse of to_rows; three rows give records that end with 0."""
        registers = self.to_registers(rows)
        size = rows[0].type.count
        return [
            self.shuffle(registers[k % COLUMNS], registers[k % COLUMNS], range(k - k % COLUMNS, k - k % COLUMNS + 4))
            for k in range(size)
        ]

    def put_rows(self, rows: Sequence[Value], work: int, row: int, start: int) -> None:
        """Store rows, each from the number `start` on."""
        for value, pointer in zip(rows, self.rows(work, row, start, len(rows)), strict=True):
            self.store(value, pointer)

    def get_rows(self, work: int, row: int, start: int, count: int = 3) -> list[Value]:
        """Load rows, each from the number `start` on."""
        return [self.load(pointer) for pointer in self.rows(work, row, start, count)]

    def rounded(self, doubles: Sequence[Value]) -> Value:
        """One register of single numbers from two registers of doubles."""
        kind = ir.VectorType(SINGLE, doubles[0].type.count)
        return self.joined([self.builder.fptrunc(value, kind) for value in doubles])

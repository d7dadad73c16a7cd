"""Tiles of a matrix product that stay in vector registers, as LLVM instructions.

Numba vectorises loops, but keeps no block of a matrix in registers: it stores and loads sums once
for every term. The two functions here add up all terms first.

symbol    meaning
------    ---------------------------------------------------------------
LANES     columns of a tile of `rows_tile`: two AVX registers, four of ARM's
R         rows of a tile, a literal
"""

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 16
#: Rows of the largest `rows_tile`: twelve of AVX's sixteen registers are then sums.
TILE_ROWS = 6
#: Rows and columns of the largest `dots_tile`: eight registers of sums. A third row would need more
#: registers than there are.
DOTS_ROWS, DOTS_COLUMNS = 2, 4

_FLOAT, _INT, _BYTE = ir.FloatType(), ir.IntType(64), ir.IntType(8)
#: Fuse a product with its sum, and reorder sums.
_FLAGS = ("contract", "reassoc", "nsz")


class _Matrix:
    """A float32 matrix, in instructions."""

    def __init__(self, context: Any, builder: Any, kind: types.Array, value: Any) -> None:
        array = context.make_array(kind)(context, builder, value)
        self._builder = builder
        self._bytes = builder.bitcast(array.data, _BYTE.as_pointer())
        self._strides = cgutils.unpack_tuple(builder, array.strides, 2)
        self.shape = cgutils.unpack_tuple(builder, array.shape, 2)

    def at(self, row: Any, column: Any, lanes: int = 1) -> Any:
        """Pointer to the float in that place, or to a vector that begins there."""
        builder = self._builder
        offset = builder.add(
            builder.mul(row, self._strides[0]), builder.mul(column, self._strides[1])
        )
        kind = _FLOAT if lanes == 1 else ir.VectorType(_FLOAT, lanes)
        return builder.bitcast(builder.gep(self._bytes, [offset]), kind.as_pointer())

    def load(self, row: Any, column: Any, lanes: int = 1) -> Any:
        """The float in that place, or so many in a row of memory."""
        return self._builder.load(self.at(row, column, lanes), align=4)


def _after(builder: Any, start: Any, count: int) -> list[Any]:
    """The integers start, start + 1, ..."""
    return [builder.add(start, ir.Constant(_INT, n)) for n in range(count)]


def _add_product(builder: Any, total: Any, x: Any, y: Any) -> Any:
    return builder.fadd(total, builder.fmul(x, y, flags=_FLAGS), flags=_FLAGS)


def _shuffled(builder: Any, x: Any, y: Any, lanes: Sequence[int]) -> Any:
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
    return builder.shuffle_vector(x, y, mask)


class _Sums:
    """A loop over `range(0, end, step)` that adds to vectors of zeros."""

    def __init__(self, builder: Any, count: int, lanes: int, end: Any, step: int) -> None:
        self._builder, self._end, self._step = builder, end, step
        vector = ir.VectorType(_FLOAT, lanes)
        before, self._body = builder.block, builder.append_basic_block("terms")
        builder.branch(self._body)
        builder.position_at_end(self._body)
        self.index = builder.phi(_INT)
        self.index.add_incoming(ir.Constant(_INT, 0), before)
        self.before = [builder.phi(vector) for _ in range(count)]
        for total in self.before:
            total.add_incoming(ir.Constant(vector, [0.0] * lanes), before)

    def close(self, after: Sequence[Any]) -> None:
        """End the loop's body, given the sums after a pass."""
        builder = self._builder
        following = builder.add(self.index, ir.Constant(_INT, self._step))
        self.index.add_incoming(following, self._body)
        for total, value in zip(self.before, after, strict=True):
            total.add_incoming(value, self._body)
        done = builder.append_basic_block("summed")
        builder.cbranch(builder.icmp_signed("<", following, self._end), self._body, done)
        builder.position_at_end(done)


@intrinsic
def rows_tile(typing_context, rows, a, row, b, column, out):
    """out[row : row + R, column : column + LANES] = a[row : row + R] @ b[:, column : column +
    LANES]; the rows of `b` and `out` are contiguous, those of `a` need not be."""
    if not isinstance(rows, types.IntegerLiteral):
        return None
    count = rows.literal_value

    def generate(context, builder, signature, values):
        left = _Matrix(context, builder, signature.args[1], values[1])
        right = _Matrix(context, builder, signature.args[3], values[3])
        target = _Matrix(context, builder, signature.args[5], values[5])
        first, column = values[2], values[4]
        numbers = _after(builder, first, count)
        sums = _Sums(builder, count, LANES, right.shape[0], 1)
        terms = right.load(sums.index, column, LANES)
        after = []
        for number, total in zip(numbers, sums.before, strict=True):
            factor = left.load(number, sums.index)
            none = ir.Constant(terms.type, ir.Undefined)
            alone = builder.insert_element(none, factor, ir.Constant(ir.IntType(32), 0))
            factors = _shuffled(builder, alone, none, [0] * LANES)
            after.append(_add_product(builder, total, factors, terms))
        sums.close(after)
        for number, total in zip(numbers, after, strict=True):
            builder.store(total, target.at(number, column, LANES), align=4)
        return context.get_dummy_value()

    return types.void(rows, a, types.int64, b, types.int64, out), generate


@intrinsic
def dots_tile(typing_context, rows, a, row, b, column, out):
    """out[row : row + R, column : column + DOTS_COLUMNS] = a[row : row + R] @ b[:, column : column
    + DOTS_COLUMNS]; the rows of `a` and `out` and the columns of `b` are contiguous, of a
    length that eight divides."""
    if not isinstance(rows, types.IntegerLiteral):
        return None
    count, lanes = rows.literal_value, 8

    def generate(context, builder, signature, values):
        left = _Matrix(context, builder, signature.args[1], values[1])
        right = _Matrix(context, builder, signature.args[3], values[3])
        target = _Matrix(context, builder, signature.args[5], values[5])
        numbers = _after(builder, values[2], count)
        columns = _after(builder, values[4], DOTS_COLUMNS)
        sums = _Sums(builder, count * DOTS_COLUMNS, lanes, right.shape[0], lanes)
        xs = [left.load(number, sums.index, lanes) for number in numbers]
        ys = [right.load(sums.index, column, lanes) for column in columns]
        pairs = [(x, y) for x in xs for y in ys]
        after = [
            _add_product(builder, total, x, y)
            for total, (x, y) in zip(sums.before, pairs, strict=True)
        ]
        sums.close(after)
        for place, number in enumerate(numbers):
            of_row = after[place * DOTS_COLUMNS : (place + 1) * DOTS_COLUMNS]
            total = _sum_each(builder, of_row)
            builder.store(total, target.at(number, values[4], DOTS_COLUMNS), align=4)
        return context.get_dummy_value()

    return types.void(rows, a, types.int64, b, types.int64, out), generate


def _sum_each(builder: Any, vectors: Sequence[Any]) -> Any:
    """The sums of four vectors of eight, as a vector of four. Vectors are added in pairs, so that
    every addition makes use of all lanes."""

    def pairwise(x: Any, y: Any) -> Any:
        even = _shuffled(builder, x, y, [0, 2, 8, 10, 4, 6, 12, 14])
        odd = _shuffled(builder, x, y, [1, 3, 9, 11, 5, 7, 13, 15])
        return builder.fadd(even, odd, flags=_FLAGS)

    first, second, third, fourth = vectors
    halves = pairwise(pairwise(first, second), pairwise(third, fourth))
    low = _shuffled(builder, halves, halves, range(4))
    high = _shuffled(builder, halves, halves, range(4, 8))
    return builder.fadd(low, high, flags=_FLAGS)

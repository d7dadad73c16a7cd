"""Tiles of a matrix product that stay in vector registers, as LLVM instructions.

A loop of Numba loads and stores every sum once per term. The two intrinsics here keep their sums in
registers.
"""

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

#: Columns of a `rows_tile`, two AVX registers, and its maximum number of rows, whose sums occupy
#: twelve of AVX's sixteen registers.
LANES, TILE_ROWS = 16, 6
#: Maximum rows and columns of a `dots_tile`, and the products that it adds at once. A third row
#: would need more registers than AVX has.
DOTS_ROWS, DOTS_COLUMNS, _DOTS_LANES = 2, 4, 8

_FLOAT, _INT, _INT32, _BYTE = ir.FloatType(), ir.IntType(64), ir.IntType(32), ir.IntType(8)
#: Fuse a product with its sum, and reorder sums.
_FLAGS = ("contract", "reassoc", "nsz")


class _Matrix:
    """A float32 matrix in LLVM instructions."""

    def __init__(self, context: Any, builder: Any, kind: types.Array, value: Any) -> None:
        array = context.make_array(kind)(context, builder, value)
        self._builder = builder
        self._bytes = builder.bitcast(array.data, _BYTE.as_pointer())
        self._strides = cgutils.unpack_tuple(builder, array.strides, 2)
        self.rows, self.columns = cgutils.unpack_tuple(builder, array.shape, 2)

    def at(self, row: Any, column: Any, lanes: int = 1) -> Any:
        """Pointer to a float, or to a vector of `lanes` floats."""
        builder, (row_stride, column_stride) = self._builder, self._strides
        offset = builder.add(builder.mul(row, row_stride), builder.mul(column, column_stride))
        kind = _FLOAT if lanes == 1 else ir.VectorType(_FLOAT, lanes)
        return builder.bitcast(builder.gep(self._bytes, [offset]), kind.as_pointer())

    def load(self, row: Any, column: Any, lanes: int = 1) -> Any:
        """A float, or a vector of `lanes` contiguous floats."""
        return self._builder.load(self.at(row, column, lanes), align=4)


def _tile(generate: Callable[..., None]) -> Any:
    """Make an intrinsic `(R, a, row, b, column, out)` of a function that generates its
    instructions; R, the number of rows, is a literal."""

    def tile(typing_context, rows, a, row, b, column, out):
        if not isinstance(rows, types.IntegerLiteral):
            return None

        def generate_call(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            left, right, target = (
                _Matrix(context, builder, signature.args[k], values[k]) for k in (1, 3, 5)
            )
            numbers = _count_from(builder, values[2], rows.literal_value)
            generate(builder, numbers, left, right, values[4], target)
            return context.get_dummy_value()

        return types.void(rows, a, types.int64, b, types.int64, out), generate_call

    return intrinsic(tile)


@_tile
def rows_tile(
    builder: Any, rows: Sequence[Any], a: _Matrix, b: _Matrix, column: Any, out: _Matrix
) -> None:
    """Compute R rows and LANES columns of out = a @ b; rows of `b` and `out` are contiguous."""

    def add(k: Any, sums: Sequence[Any]) -> list[Any]:
        terms = b.load(k, column, LANES)
        undefined = ir.Constant(terms.type, ir.Undefined)
        added = []
        for row, total in zip(rows, sums, strict=True):
            first = builder.insert_element(undefined, a.load(row, k), ir.Constant(_INT32, 0))
            factors = _shuffle(builder, first, undefined, [0] * LANES)
            added.append(_add_product(builder, total, factors, terms))
        return added

    for row, total in zip(rows, _sum(builder, len(rows), LANES, b.rows, 1, add), strict=True):
        builder.store(total, out.at(row, column, LANES), align=4)


@_tile
def dots_tile(
    builder: Any, rows: Sequence[Any], a: _Matrix, b: _Matrix, column: Any, out: _Matrix
) -> None:
    """Compute R rows and DOTS_COLUMNS columns of out = a @ b; the rows of `a` and `out` and the
    columns of `b` are contiguous, and their length is a multiple of eight."""
    columns = _count_from(builder, column, DOTS_COLUMNS)

    def add(k: Any, sums: Sequence[Any]) -> list[Any]:
        xs = [a.load(row, k, _DOTS_LANES) for row in rows]
        ys = [b.load(k, column, _DOTS_LANES) for column in columns]
        pairs = ((x, y) for x in xs for y in ys)
        return [_add_product(builder, s, x, y) for s, (x, y) in zip(sums, pairs, strict=True)]

    count = len(rows) * DOTS_COLUMNS
    sums = _sum(builder, count, _DOTS_LANES, b.rows, _DOTS_LANES, add)
    for number, row in enumerate(rows):
        total = _sum_each(builder, sums[number * DOTS_COLUMNS :][:DOTS_COLUMNS])
        builder.store(total, out.at(row, column, DOTS_COLUMNS), align=4)


def _sum(builder: Any, count: int, lanes: int, end: Any, step: int, add: Any) -> Any:
    """Generate a loop over `range(0, end, step)`; `add(k, sums)` returns the new sums, which are
    `count` vectors and start from 0."""
    zeros = ir.Constant(ir.VectorType(_FLOAT, lanes), [0.0] * lanes)
    before, body = builder.block, builder.append_basic_block("terms")
    builder.branch(body)
    builder.position_at_end(body)
    k, sums = builder.phi(_INT), [builder.phi(zeros.type) for _ in range(count)]
    added = add(k, sums)
    following = builder.add(k, ir.Constant(_INT, step))
    starts = [ir.Constant(_INT, 0), *[zeros] * count]
    for phi, start, value in zip([k, *sums], starts, [following, *added], strict=True):
        phi.add_incoming(start, before)
        phi.add_incoming(value, body)
    done = builder.append_basic_block("summed")
    builder.cbranch(builder.icmp_signed("<", following, end), body, done)
    builder.position_at_end(done)
    return added


def _sum_each(builder: Any, vectors: Sequence[Any]) -> Any:
    """Reduce four vectors of eight to a vector of their sums, in pairs, so that every addition uses
    all lanes."""

    def pairwise(x: Any, y: Any) -> Any:
        even = _shuffle(builder, x, y, [0, 2, 8, 10, 4, 6, 12, 14])
        odd = _shuffle(builder, x, y, [1, 3, 9, 11, 5, 7, 13, 15])
        return builder.fadd(even, odd, flags=_FLAGS)

    first, second, third, fourth = vectors
    halves = pairwise(pairwise(first, second), pairwise(third, fourth))
    low, high = (_shuffle(builder, halves, halves, range(k, k + 4)) for k in (0, 4))
    return builder.fadd(low, high, flags=_FLAGS)


def _count_from(builder: Any, start: Any, count: int) -> list[Any]:
    """The integers start, start + 1, ..."""
    return [builder.add(start, ir.Constant(_INT, n)) for n in range(count)]


def _add_product(builder: Any, total: Any, x: Any, y: Any) -> Any:
    return builder.fadd(total, builder.fmul(x, y, flags=_FLAGS), flags=_FLAGS)


def _shuffle(builder: Any, x: Any, y: Any, lanes: Sequence[int]) -> Any:
    mask = ir.Constant(ir.VectorType(_INT32, len(lanes)), list(lanes))
    return builder.shuffle_vector(x, y, mask)

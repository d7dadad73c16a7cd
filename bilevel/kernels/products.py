"""Products of small matrices, as `numpy.dot(a, b, out)`.

OpenBLAS copies all operands before it multiplies, which costs more than a small product, except on
processors with AVX-512 (its pull request 3335). On all other processors `tiles` computes these.
"""

from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba.extending import overload

from bilevel.kernels.jit import compiled_apart
from bilevel.kernels.tiles import DOTS_COLUMNS, DOTS_ROWS, LANES, TILE_ROWS, dots_tile, rows_tile

#: True on processors where products are made of tiles.
TILED = not llvm.get_host_cpu_features().get("avx512f", False)
#: Elements of a weight matrix, or of its gradient, up to which tiles are about as fast as BLAS
#: (`benchmarks.speed.products`).
LARGEST = 128 * 128


def product(a: Any, b: Any, out: Any) -> None:
    """Write a @ b into `out`, all float32; `b` or its transpose, and `out`, are contiguous."""


@overload(product, strict=False)
def _product(a, b, out):
    if out.layout != "C" or b.layout not in "CF":
        return None
    if b.layout == "F":
        return lambda a, b, out: _product_of_rows(a, b, out)
    return lambda a, b, out: _product_with_rows(a, b, out)


@compiled_apart
def _product_with_rows(a, b, out):
    if TILED and b.shape[1] % LANES == 0 and a.size <= LARGEST:
        tiles_with_rows(a, b, out)
    else:
        np.dot(a, b, out)


@compiled_apart
def _product_of_rows(a, b, out):
    whole = b.shape[0] % LANES == 0 and b.shape[1] >= DOTS_COLUMNS
    if TILED and whole and out.size <= LARGEST:
        tiles_of_rows(a, b, out)
    else:
        np.dot(a, b, out)


@compiled_apart
def tiles_with_rows(a, b, out):
    """Compute a product by tiles, for a `b` with contiguous rows, whose length LANES divides."""
    rows = a.shape[0]
    tiled = rows - rows % TILE_ROWS
    for column in range(0, b.shape[1], LANES):
        for row in range(0, tiled, TILE_ROWS):
            rows_tile(TILE_ROWS, a, row, b, column, out)
        for row in range(tiled, rows - 1, 2):
            rows_tile(2, a, row, b, column, out)
        if rows % 2 == 1:
            rows_tile(1, a, rows - 1, b, column, out)


@compiled_apart
def tiles_of_rows(a, b, out):
    """Compute a product by tiles, for a `b` with contiguous columns, at least DOTS_COLUMNS, whose
    length LANES divides."""
    rows, columns = out.shape
    for start in range(0, columns, DOTS_COLUMNS):
        column = min(start, columns - DOTS_COLUMNS)  # the last tile may overlap the previous one
        for row in range(0, rows - 1, DOTS_ROWS):
            dots_tile(DOTS_ROWS, a, row, b, column, out)
        if rows % DOTS_ROWS == 1:
            dots_tile(1, a, rows - 1, b, column, out)

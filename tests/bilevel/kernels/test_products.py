from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bilevel.kernels.jit import compiled
from bilevel.kernels.products import LARGEST, product, tiles_of_rows, tiles_with_rows


@compiled
def multiplied(a, b, out):  # type: ignore[no-untyped-def]
    product(a, b, out)


def assert_product(a: np.ndarray, b: np.ndarray, multiply: Callable[..., Any] = multiplied) -> None:
    """Multiply into the middle of an array, whose other elements must keep their values."""
    size = a.shape[0] * b.shape[1]
    memory = np.full(size + 64, np.float32(7), np.float32)
    out = memory[32:-32].reshape(a.shape[0], b.shape[1])
    multiply(a, b, out)
    np.testing.assert_allclose(out, a @ b, atol=1e-4)
    assert (memory[:32] == 7).all()
    assert (memory[-32:] == 7).all()


@pytest.mark.parametrize(
    "shape",
    # The last two are BLAS's: too large, and not whole tiles.
    [(7, 1, 16), (1, 16, 16), (57, 208, 64), (130, LARGEST // 130 + 1, 32), (6, 3, 33)],
)
def test_products_equal_numpys(shape: tuple[int, int, int], rng: np.random.Generator) -> None:
    rows, terms, columns = shape
    a = rng.normal(0, 1, (rows, terms)).astype(np.float32)
    b = rng.normal(0, 1, (terms, columns)).astype(np.float32)
    for left in (a, a.T.copy().T):
        assert_product(left, b)
    assert_product(a, b.T.copy().T)


def test_tiles_equal_numpy_on_every_processor(rng: np.random.Generator) -> None:
    for rows in (*range(1, 14), 140):
        a = rng.normal(0, 1, (rows, 144)).astype(np.float32)
        assert_product(a, rng.normal(0, 1, (144, 48)).astype(np.float32), tiles_with_rows)
        assert_product(a, rng.normal(0, 1, (141, 144)).astype(np.float32).T, tiles_of_rows)

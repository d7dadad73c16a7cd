"""Time of the matrix products of a gradient step: tiles (`bilevel.kernels.products`) and BLAS.

    python -m benchmarks.speed.products

Both run alternately in one process on one core.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.machine import spread, write_result
from bilevel.kernels.jit import compiled
from bilevel.kernels.products import tiles_of_rows, tiles_with_rows
from bilevel.threads import one_blas_thread

REPEATS = 15
#: Approximate seconds of one measurement.
SECONDS = 0.01
#: Hidden units and batch sizes: of NES's small agents, of the paper's optimized agent, and larger.
SIZES = ((44, 48), (57, 208), (128, 128), (256, 256), (384, 384))


def cases(units: int, batch: int) -> dict[str, tuple[Callable[..., Any], Any, Any]]:
    """Return tile function and factors of the products of a network with 4 inputs, 2 outputs."""
    rng = np.random.default_rng(0)

    def random(*shape: int) -> Any:
        return rng.normal(0, 1, shape).astype(np.float32)

    return {
        "inputs to hidden": (tiles_with_rows, random(units, 4), random(4, batch)),
        "hidden to hidden": (tiles_with_rows, random(units, units), random(units, batch)),
        "hidden to outputs": (tiles_with_rows, random(2, units), random(units, batch)),
        "gradient of hidden": (tiles_with_rows, random(units, units).T, random(units, batch)),
        "gradient of hidden weights": (tiles_of_rows, random(units, batch), random(units, batch).T),
        "gradient of output weights": (tiles_of_rows, random(2, batch), random(units, batch).T),
    }


@compiled
def blas(a, b, out):  # type: ignore[no-untyped-def]
    """Multiply two matrices with BLAS."""
    np.dot(a, b, out)


@compiled
def _repeat(multiply, a, b, out, count):  # type: ignore[no-untyped-def]
    for _ in range(count):
        multiply(a, b, out)


def measure(tiles: Callable[..., Any], a: Any, b: Any) -> dict[str, Any]:
    """Return microseconds of both products, and their ratio over `REPEATS` pairs."""
    out = np.zeros((a.shape[0], b.shape[1]), np.float32)

    def microseconds(multiply: Callable[..., Any], count: int) -> float:
        started = time.perf_counter()
        _repeat(multiply, a, b, out, count)
        return (time.perf_counter() - started) / count * 1e6

    for multiply in (tiles, blas):
        microseconds(multiply, 1)
    count = max(round(SECONDS * 1e6 / microseconds(blas, 10)), 1)
    pairs = [(microseconds(tiles, count), microseconds(blas, count)) for _ in range(REPEATS)]
    return {
        "tiles_us": spread([of_tiles for of_tiles, _ in pairs]),
        "blas_us": spread([of_blas for _, of_blas in pairs]),
        "ratio": spread([of_blas / of_tiles for of_tiles, of_blas in pairs]),
    }


def main() -> None:
    """Measure all products and write `results/products.json`."""
    results = {}
    with one_blas_thread():
        for units, batch in SIZES:
            for name, (tiles, a, b) in cases(units, batch).items():
                label = f"{name}, {units} units, batch {batch}"
                results[label] = measure(tiles, a, b)
                print(label, results[label], flush=True)
    values = {"repeats": REPEATS, "unit": "microseconds, one core", "results": results}
    write_result("products", "python -m benchmarks.speed.products", values)


if __name__ == "__main__":
    main()

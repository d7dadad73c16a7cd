"""Products of the shapes of a gradient step: of tiles (`bilevel.kernels.products`) beside BLAS's,
in one process, on one core.

    python -m benchmarks.speed.products
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
    """The way of multiplication by tiles, and the factors, of the products of a network of that
    width with 4 inputs and 2 outputs."""
    rng = np.random.default_rng(0)

    def drawn(*shape: int) -> Any:
        return rng.normal(0, 1, shape).astype(np.float32)

    return {
        "inputs to hidden": (tiles_with_rows, drawn(units, 4), drawn(4, batch)),
        "hidden to hidden": (tiles_with_rows, drawn(units, units), drawn(units, batch)),
        "hidden to outputs": (tiles_with_rows, drawn(2, units), drawn(units, batch)),
        "gradient of hidden": (tiles_with_rows, drawn(units, units).T, drawn(units, batch)),
        "gradient of hidden weights": (tiles_of_rows, drawn(units, batch), drawn(units, batch).T),
        "gradient of output weights": (tiles_of_rows, drawn(2, batch), drawn(units, batch).T),
    }


@compiled
def _dot(a, b, out):  # type: ignore[no-untyped-def]
    np.dot(a, b, out)


@compiled
def _repeat(multiply, a, b, out, count):  # type: ignore[no-untyped-def]
    for _ in range(count):
        multiply(a, b, out)


def measure(tiles: Callable[..., Any], a: Any, b: Any) -> dict[str, Any]:
    """Microseconds of a product by tiles and by BLAS, and the ratio over `REPEATS` pairs."""
    out = np.zeros((a.shape[0], b.shape[1]), np.float32)

    def microseconds(multiply: Callable[..., Any], count: int) -> float:
        started = time.perf_counter()
        _repeat(multiply, a, b, out, count)
        return (time.perf_counter() - started) / count * 1e6

    for multiply in (tiles, _dot):
        microseconds(multiply, 1)
    count = max(round(SECONDS * 1e6 / microseconds(_dot, 10)), 1)
    pairs = [(microseconds(tiles, count), microseconds(_dot, count)) for _ in range(REPEATS)]
    return {
        "tiles_us": spread([of_tiles for of_tiles, _ in pairs]),
        "blas_us": spread([of_blas for _, of_blas in pairs]),
        "ratio": spread([of_blas / of_tiles for of_tiles, of_blas in pairs]),
    }


def main() -> None:
    """Measure all products, write `results/products.json`."""
    results = {}
    with one_blas_thread():
        for units, batch in SIZES:
            for name, (tiles, a, b) in cases(units, batch).items():
                label = f"{name}, {units} units, batch {batch}"
                results[label] = measure(tiles, a, b)
                print(label, results[label], flush=True)
    values = {"repeats": REPEATS, "unit": "microseconds, one core", "results": results}
    print(f"written to {write_result('products', 'python -m benchmarks.speed.products', values)}")


if __name__ == "__main__":
    main()

import numpy as np
import pytest

from benchmarks.speed import products
from benchmarks.speed.products import SIZES, cases, measure


@pytest.mark.parametrize(("units", "batch"), SIZES[:3])
def test_both_ways_multiply_the_matrices_of_the_label(units: int, batch: int) -> None:
    sizes = {"inputs": 4, "hidden": units, "outputs": 2}
    for label, (tiles, a, b) in cases(units, batch).items():
        if " to " in label:
            before, after = label.split(" to ")
            assert (*a.shape, b.shape[1]) == (sizes[after], sizes[before], batch)
        out = np.zeros((a.shape[0], b.shape[1]), np.float32)
        tiles(a, b, out)
        np.testing.assert_allclose(out, a @ b, rtol=1e-3, atol=1e-3)
        products._dot(a, b, out)
        np.testing.assert_allclose(out, a @ b, rtol=1e-3, atol=1e-3)


def test_a_row_is_of_one_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(products, "SECONDS", 0.001)
    monkeypatch.setattr(products, "REPEATS", 1)
    row = measure(*cases(44, 48)["hidden to hidden"])
    assert row["ratio"]["median"] == pytest.approx(
        row["blas_us"]["median"] / row["tiles_us"]["median"], rel=0.02
    )

from pathlib import Path

import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from benchmarks.speed import inner_loop, products
from benchmarks.speed.vector_env import BATCHED, LOOPED, copies_of
from bilevel.gym.vector_env import SyntheticVectorEnv
from bilevel.threads import one_blas_thread


@pytest.mark.parametrize("label", ["CartPole, DDQN, 1 x 42, batch 42", "CartPole, TD3, default"])
def test_inner_loop_measures_both_forms(label: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inner_loop, "SECONDS", 0.002)
    monkeypatch.setattr(inner_loop, "REPEATS", 1)
    with one_blas_thread():
        row = inner_loop.measure(inner_loop.cases()[label])
    kernel, torch = row["kernel_us"]["median"], row["torch_us"]["median"]
    assert row["ratio"]["median"] == pytest.approx(torch / kernel, rel=0.01, abs=0.01)


@pytest.mark.parametrize(("units", "batch"), products.SIZES[:3])
def test_tiles_and_blas_multiply_the_same_matrices(units: int, batch: int) -> None:
    sizes = {"inputs": 4, "hidden": units, "outputs": 2}
    for label, (tiles, a, b) in products.cases(units, batch).items():
        if " to " in label:
            before, after = label.split(" to ")
            assert (*a.shape, b.shape[1]) == (sizes[after], sizes[before], batch)
        for multiply in (tiles, products.blas):
            out = np.zeros((a.shape[0], b.shape[1]), np.float32)
            multiply(a, b, out)
            np.testing.assert_allclose(out, a @ b, rtol=1e-3, atol=1e-3)


def test_products_measures_their_ratio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(products, "SECONDS", 0.001)
    monkeypatch.setattr(products, "REPEATS", 1)
    row = products.measure(*products.cases(44, 48)["hidden to hidden"])
    ratio = row["blas_us"]["median"] / row["tiles_us"]["median"]
    assert row["ratio"]["median"] == pytest.approx(ratio, rel=0.02)


@pytest.mark.parametrize(("mode", "kind"), [(BATCHED, SyntheticVectorEnv), (LOOPED, SyncVectorEnv)])
def test_vector_env_compares_both_loops(mode: str, kind: type, se_file: Path) -> None:
    env = copies_of(se_file, 3, mode)
    assert isinstance(env.unwrapped, kind)
    assert env.num_envs == 3

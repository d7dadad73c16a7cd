"""Steps per second of many copies of an SE: the vector environment and gymnasium's loop.

    python -m benchmarks.speed.vector_env

Both take the same number of steps with the same actions, alternately.
"""

import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import bilevel  # noqa: F401  (registers the environment)
from benchmarks.machine import read_result, spread, write_result
from benchmarks.markdown import rate_rows, table
from bilevel.zoo import zoo_file

COPIES, STEPS, REPEATS = (8, 64), 400, 7
BATCHED, LOOPED = "vector_entry_point", "sync"


def copies_of(path: Path, copies: int, mode: str) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """Return a vector environment with copies of an SE."""
    return gymnasium.make_vec(
        "bilevel/SyntheticEnv-v0", num_envs=copies, vectorization_mode=mode, path=path
    )


def rate(path: Path, copies: int, mode: str) -> float:
    """Return steps per second of all copies together."""
    env = copies_of(path, copies, mode)
    actions = np.random.default_rng(0).integers(2, size=(STEPS, copies))
    env.reset(seed=0)
    started = time.perf_counter()
    for row in actions:
        env.step(row)
    return STEPS * copies / (time.perf_counter() - started)


def vector_env() -> str:
    """Return the table."""
    result = read_result("vector_env")
    head = "copies", "steps per second together", "in gymnasium's loop", "times as fast"
    return table(head, rate_rows(result["rates"], ("batched", "looped"), ".1f"), result)


def main() -> None:
    """Measure and write `results/vector_env.json`."""
    rows = {}
    path = zoo_file("CartPole-v0")
    for copies in COPIES:
        for mode in (BATCHED, LOOPED):
            rate(path, copies, mode)  # loads the kernels
        pairs = [(rate(path, copies, BATCHED), rate(path, copies, LOOPED)) for _ in range(REPEATS)]
        rows[str(copies)] = {
            "batched": spread([batched for batched, _ in pairs]),
            "looped": spread([looped for _, looped in pairs]),
            "ratio": spread([batched / looped for batched, looped in pairs]),
        }
        print(copies, rows[str(copies)], flush=True)
    command = "python -m benchmarks.speed.vector_env"
    write_result("vector_env", command, {"repeats": REPEATS, "rates": rows})


if __name__ == "__main__":
    main()

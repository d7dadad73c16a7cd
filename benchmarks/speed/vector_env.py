"""Steps per second of many copies of an SE: the vector environment beside gymnasium's loop.

    python -m benchmarks.speed.vector_env

Both take the same number of steps with the same actions, one after the other, REPEATS times.
"""

import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import bilevel  # noqa: F401  (registers the environment)
from benchmarks.machine import spread, write_result
from bilevel.hyperparameters import load_recipe
from bilevel.synthetic_env import SEDistribution, StoredSE, coordinates, save_se
from bilevel.tasks import get_task

COPIES, STEPS, REPEATS = (8, 64), 400, 7
BATCHED, LOOPED = "vector_entry_point", "sync"


def copies_of(path: Path, copies: int, mode: str) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """Copies of an SE that take their steps together."""
    return gymnasium.make_vec(
        "bilevel/SyntheticEnv-v0", num_envs=copies, vectorization_mode=mode, path=path
    )


def rate(path: Path, copies: int, mode: str) -> float:
    """Steps per second of all copies together."""
    env = copies_of(path, copies, mode)
    actions = np.random.default_rng(0).integers(2, size=(STEPS, copies))
    env.reset(seed=0)
    began = time.perf_counter()
    for row in actions:
        env.step(row)
    return STEPS * copies / (time.perf_counter() - began)


def main() -> None:
    """Measure and write the result."""
    task = get_task("CartPole-v0")
    space = coordinates(task, load_recipe("default", task.id).se, task.observation_scale(1))
    theta = space.initialize(np.random.default_rng(0))
    se = SEDistribution(space, theta, theta, theta).centre
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "se.safetensors"
        save_se(StoredSE(se, task.id, task.step_limit, task.solved_reward), path)
        for copies in COPIES:
            for mode in (BATCHED, LOOPED):
                rate(path, copies, mode)  # loads the kernels
            pairs = [
                (rate(path, copies, BATCHED), rate(path, copies, LOOPED)) for _ in range(REPEATS)
            ]
            rows[str(copies)] = {
                "batched": spread([one for one, _ in pairs]),
                "looped": spread([other for _, other in pairs]),
                "ratio": spread([one / other for one, other in pairs]),
            }
            print(copies, rows[str(copies)], flush=True)
    command = "python -m benchmarks.speed.vector_env"
    write_result("vector_env", command, {"repeats": REPEATS, "rates": rows})


if __name__ == "__main__":
    main()

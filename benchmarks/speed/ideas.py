"""Ideas for the inner loop that can be judged apart from it, each against what is there.

python -m benchmarks.speed.ideas

one product     the online network on states and next states: one product of twice the
                columns instead of two
one workspace   an agent's arrays kept from evaluation to evaluation instead of made anew
square root     Adam with the processor's division and square root instead of approximations
                with a Newton step (`kernels.jit`)
"""

import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import spread, write_result
from bilevel.agents import get_agent
from bilevel.hyperparameters import DDQNHyperparameters, load_preset
from bilevel.kernels.adam import BETA1, BETA2, EPSILON, adam_step
from bilevel.kernels.ddqn import q_network
from bilevel.kernels.jit import FAST_MATH
from bilevel.kernels.mlp import padded
from bilevel.tasks import get_task

REPEATS = 9


@numba.njit(fastmath=FAST_MATH, error_model="numpy")  # type: ignore[untyped-decorator]
def _exact_adam(params: Any, gradient: Any, first: Any, second: Any, step: int, rate: float) -> Any:
    f = np.float32
    size = f(rate / (1.0 - BETA1**step))
    inverse = f(1) / f(np.sqrt(1.0 - BETA2**step))
    for i in range(params.size):
        g = gradient[i]
        m = f(BETA1) * first[i] + f(1 - BETA1) * g
        v = f(BETA2) * second[i] + f(1 - BETA2) * g * g
        first[i] = m
        second[i] = v
        params[i] -= size * m / (np.sqrt(v) * inverse + f(EPSILON))


def _microseconds(action: Callable[[], Any], calls: int) -> float:
    started = time.perf_counter()
    for _ in range(calls):
        action()
    return (time.perf_counter() - started) / calls * 1e6


def _compared(one: Callable[[], Any], other: Callable[[], Any], calls: int) -> dict[str, Any]:
    """Microseconds of both in turns, and the ratio, in the same run."""
    one(), other()
    pairs = [(_microseconds(one, calls), _microseconds(other, calls)) for _ in range(REPEATS)]
    return {
        "as_it_is_us": spread([pair[0] for pair in pairs]),
        "idea_us": spread([pair[1] for pair in pairs]),
        "times_as_fast": spread([pair[0] / pair[1] for pair in pairs]),
    }


def one_product(hp: DDQNHyperparameters) -> dict[str, Any]:
    """The products of the online network for a batch of states and one of next states."""
    task, columns = get_task("CartPole-v0"), padded(hp.batch_size)
    sizes = q_network(hp, task.state_size, task.n_actions).sizes.tolist()
    rng = np.random.default_rng(0)

    def array(*shape: int) -> NDArray[np.float32]:
        return rng.normal(size=shape).astype(np.float32)

    weights = [array(after, before) for before, after in pairwise(sizes)]
    narrow = [array(size, columns) for size in sizes]
    wide = [array(size, 2 * columns) for size in sizes]

    def forward(layers: list[NDArray[np.float32]]) -> None:
        for w, x, y in zip(weights, layers, layers[1:], strict=False):
            np.dot(w, x, y)

    def twice() -> None:
        forward(narrow)
        forward(narrow)

    return _compared(twice, lambda: forward(wide), 2000)


def one_workspace(hp: DDQNHyperparameters) -> dict[str, Any]:
    """A fresh agent with its arrays, which is made once an evaluation."""
    task, build = get_task("CartPole-v0"), get_agent("ddqn").build_kernel
    assert build is not None
    kept = build(hp, task.state_size, task.n_actions, np.random.default_rng(0))
    arrays = [field for field in kept if isinstance(field, np.ndarray)]

    def refill() -> None:
        for array in arrays:
            array.fill(0)

    return _compared(
        lambda: build(hp, task.state_size, task.n_actions, np.random.default_rng(0)), refill, 200
    )


def square_root(hp: DDQNHyperparameters) -> dict[str, Any]:
    """A step of Adam on the agent's parameters."""
    task, build = get_task("CartPole-v0"), get_agent("ddqn").build_kernel
    assert build is not None
    kernel = build(hp, task.state_size, task.n_actions, np.random.default_rng(0))
    gradient = np.random.default_rng(1).normal(size=kernel.theta.size).astype(np.float32)
    arrays = (kernel.theta, gradient, kernel.first, kernel.second)
    return _compared(
        lambda: adam_step(*arrays, 9, 1e-3), lambda: _exact_adam(*arrays, 9, 1e-3), 2000
    )


def main() -> None:
    """Measure all, write `results/ideas.json`."""
    results = {}
    for name, preset in (("Table 1", "tuned"), ("2 x 128", "default")):
        (hp,) = load_preset(preset, "CartPole-v0").agents
        assert isinstance(hp, DDQNHyperparameters)
        results[name] = {
            "one product": one_product(hp),
            "one workspace": one_workspace(hp),
            "square root": square_root(hp),
        }
        print(name, results[name], flush=True)
    values = {"repeats": REPEATS, "results": results}
    print(f"written to {write_result('ideas', 'python -m benchmarks.speed.ideas', values)}")


if __name__ == "__main__":
    main()

"""Time of one inner-loop step (environment step and gradient step) of each agent on an SE.

    python -m benchmarks.speed.inner_loop

Compiled kernel and torch definition run alternately in one process on one core.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from benchmarks.machine import read_result, spread, write_result
from benchmarks.markdown import format_spread, table
from bilevel.agents import get_agent
from bilevel.agents.agent import agent_seeds
from bilevel.agents.environments import KernelEnvironment, compiled_environment
from bilevel.agents.training import train as train_in_python
from bilevel.evaluation.run import schedule
from bilevel.hyperparameters import AgentHyperparameters, SEHyperparameters
from bilevel.kernels import training
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import get_task
from bilevel.threads import one_blas_thread

REPEATS = 7
#: Approximate seconds of one measurement.
SECONDS = 0.25
#: All episodes have this length, because the SE's done output is always negative.
EPISODE_STEPS = 50


@dataclass(frozen=True)
class Case:
    """An agent and the SE that it trains on."""

    task_id: str
    agent: AgentHyperparameters
    se: SEHyperparameters


def cases() -> dict[str, Case]:
    """Return the cases by label.

    "optimized" are the paper's optimized hyperparameters for the task; "default" is its default
    table. A label with sizes is the default with these sizes.
    """
    return {
        "CartPole, DDQN, optimized": _case("CartPole-v0", "CartPole-v0", "ddqn"),
        "Acrobot, DDQN, optimized": _case("Acrobot-v1", "Acrobot-v1", "ddqn"),
        "CartPole, DDQN, default (2 x 128)": _case("CartPole-v0", "", "ddqn"),
        "CartPole, Dueling DDQN, default": _case("CartPole-v0", "", "dueling-ddqn"),
        "CartPole, TD3, default": _case("CartPole-v0", "", "td3"),
        "CartPole, DDQN, 1 x 42, batch 42": _case(
            "CartPole-v0", "", "ddqn", hidden_layers=1, hidden_size=42, batch_size=42
        ),
        "CartPole, DDQN, 1 x 384": _case(
            "CartPole-v0", "", "ddqn", hidden_layers=1, hidden_size=384
        ),
        "CartPole, DDQN, 3 x 384, batch 384": _case(
            "CartPole-v0", "", "ddqn", hidden_layers=3, hidden_size=384, batch_size=384
        ),
    }


def _case(task_id: str, column: str, agent: str, **changes: Any) -> Case:
    """Return a case with the recipe `paper` for the task `column`; "" is its default table."""
    hp = load_recipe("paper", column, (agent,))
    return Case(task_id, replace(hp.agents[0], **changes), hp.se)


def measure(case: Case) -> dict[str, Any]:
    """Return microseconds per step of both, and their ratio over `REPEATS` pairs."""
    kernel, definition = _kernel_and_definition(case)
    kernel(2)
    definition(1)
    numbers = [
        max(round(SECONDS * 1e6 / microseconds / EPISODE_STEPS), 1)
        for microseconds in (kernel(2), definition(1))
    ]
    pairs = [(kernel(numbers[0]), definition(numbers[1])) for _ in range(REPEATS)]
    return {
        "kernel_us": spread([k for k, _ in pairs]),
        "torch_us": spread([t for _, t in pairs]),
        "ratio": spread([t / k for k, t in pairs]),
    }


def _kernel_and_definition(case: Case) -> tuple[Callable[[int], float], Callable[[int], float]]:
    """Return functions that train for some episodes and return microseconds per step."""
    task = get_task(case.task_id)
    hp: Any = replace(case.agent, init_episodes=0, early_out_episodes=10**6)
    architecture = replace(Architecture.of(task, case.se), step_limit=EPISODE_STEPS)
    psi = architecture.initialize(np.random.default_rng(0)) * np.float32(0.3)
    env = compiled_environment(task, SE(architecture, psi), episodes=100, seed=1)
    env.se.output_biases[-1] = -10.0
    registered = get_agent(hp.agent)
    build_kernel: Any = registered.build_kernel
    initial, loop = agent_seeds(0)

    def kernel(episodes: int) -> float:
        fresh = build_kernel(hp, task.state_size, task.action_size, np.random.default_rng(initial))
        plan = schedule(replace(hp, max_episodes=episodes))
        started = time.perf_counter()
        steps, _, _ = training.train(fresh, env, plan, np.array([loop], np.uint64))
        return (time.perf_counter() - started) / int(steps) * 1e6

    def definition(episodes: int) -> float:
        fresh = registered.build(hp, task.state_size, task.action_size, 0)
        plan = replace(hp, max_episodes=episodes)
        started = time.perf_counter()
        in_python = KernelEnvironment(env, task.action_size)
        steps, _, _ = train_in_python(fresh, plan, in_python, lambda returns: False)
        return (time.perf_counter() - started) / steps * 1e6

    return kernel, definition


def inner_loop() -> str:
    """Return the table."""
    result = read_result("inner_loop")
    rows = [
        (
            label,
            f"{case['kernel_us']['median']:.0f} µs",
            f"{case['torch_us']['median']:.0f} µs",
            format_spread(case["ratio"], ".1f"),
        )
        for label, case in result["results"].items()
    ]
    return table(("agent", "compiled", "torch definition", "times as fast"), rows, result)


def main() -> None:
    """Measure all cases and write `results/inner_loop.json`."""
    torch.set_num_threads(1)
    results = {}
    with one_blas_thread():
        for label, case in cases().items():
            results[label] = measure(case)
            print(label, results[label], flush=True)
    values = {"repeats": REPEATS, "unit": "microseconds per step, one core", "results": results}
    write_result("inner_loop", "python -m benchmarks.speed.inner_loop", values)


if __name__ == "__main__":
    main()

"""One inner-loop step (environment step plus gradient step) of every built-in agent on an
SE: the compiled kernel against the torch definition, in turn, in one process, on one core;
and how far the kernel is from the least time its arithmetic can take (`bound`).

    python -m benchmarks.speed.inner_loop
"""

import time
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from benchmarks.machine import spread, write_result
from benchmarks.speed.bound import Core, measure_core, step_work
from bilevel.agents import get_agent
from bilevel.agents.agent import agent_seeds
from bilevel.agents.environments import KernelEnvironment
from bilevel.agents.training import train as train_in_python
from bilevel.evaluation import schedule
from bilevel.hyperparameters import load_preset
from bilevel.kernels import training
from bilevel.kernels.environment import environment
from bilevel.synthetic_env import Architecture, kernel_form
from bilevel.tasks import get_task

REPEATS = 7
#: Seconds of one measurement, about; every step of it learns, and every episode has as
#: many steps, as the SE's done output is silenced.
SECONDS = 0.25
EPISODE_STEPS = 50

#: Name: task, preset, agent, and what differs from the preset. The last ones lie in the
#: ranges of varied hyperparameters.
CASES: dict[str, tuple[str, str, str, dict[str, int]]] = {
    "CartPole, DDQN, Table 1": ("CartPole-v0", "tuned", "ddqn", {}),
    "Acrobot, DDQN, Table 1": ("Acrobot-v1", "tuned", "ddqn", {}),
    "CartPole, DDQN, default (2 x 128)": ("CartPole-v0", "default", "ddqn", {}),
    "CartPole, Dueling DDQN, default": ("CartPole-v0", "default", "dueling-ddqn", {}),
    "CartPole, TD3, default": ("CartPole-v0", "default", "td3", {}),
    "CartPole, DDQN, 1 x 42, batch 42": (
        "CartPole-v0",
        "default",
        "ddqn",
        {"hidden_layers": 1, "hidden_size": 42, "batch_size": 42},
    ),
    "CartPole, DDQN, 1 x 384": (
        "CartPole-v0",
        "default",
        "ddqn",
        {"hidden_layers": 1, "hidden_size": 384},
    ),
    "CartPole, DDQN, 3 x 384, batch 384": (
        "CartPole-v0",
        "default",
        "ddqn",
        {"hidden_layers": 3, "hidden_size": 384, "batch_size": 384},
    ),
}


def measure(
    core: Core, task_id: str, preset: str, agent: str, changes: dict[str, int]
) -> dict[str, Any]:
    """Microseconds per step of both, their ratio over `REPEATS` pairs, and the bound."""
    task = get_task(task_id)
    preset_hp = load_preset(preset, task_id, agents=(agent,))
    hp: Any = replace(preset_hp.agents[0], init_episodes=0, early_out_episodes=10**6)
    hp = replace(hp, **changes)
    architecture = Architecture.of(task, preset_hp.se)
    se = kernel_form(
        architecture, architecture.initialize(np.random.default_rng(0)) * np.float32(0.3)
    )
    se.output_biases[-1] = -10.0
    env = environment(
        se,
        True,
        task.dynamics,
        task.state_size,
        EPISODE_STEPS,
        0.0,
        task.initial_physics(np.random.default_rng(1), 100),
    )
    registered = get_agent(agent)
    assert registered.build_kernel is not None
    initial, loop = agent_seeds(0)

    def kernel(episodes: int) -> float:
        assert registered.build_kernel is not None
        fresh = registered.build_kernel(
            hp, task.state_size, task.n_actions, np.random.default_rng(initial)
        )
        plan = schedule(replace(hp, max_episodes=episodes))
        started = time.perf_counter()
        steps, _, _ = training.train(fresh, env, plan, np.array([loop], np.uint64))
        return (time.perf_counter() - started) / int(steps) * 1e6

    def definition(episodes: int) -> float:
        fresh = registered.build(hp, task.state_size, task.n_actions, 0)
        plan = replace(hp, max_episodes=episodes)
        started = time.perf_counter()
        steps, _, _ = train_in_python(fresh, plan, KernelEnvironment(env), lambda returns: False)
        return (time.perf_counter() - started) / steps * 1e6

    def episodes_for(microseconds: float) -> int:
        return max(round(SECONDS * 1e6 / microseconds / EPISODE_STEPS), 1)

    kernel(2)
    definition(1)
    n_kernel, n_definition = episodes_for(kernel(2)), episodes_for(definition(1))
    pairs = [(kernel(n_kernel), definition(n_definition)) for _ in range(REPEATS)]
    bound = step_work(hp, architecture).microseconds(core)
    return {
        "kernel_us": spread([k for k, _ in pairs]),
        "torch_us": spread([t for _, t in pairs]),
        "ratio": spread([t / k for k, t in pairs]),
        "bound_us": round(bound, 2),
        "over_bound": spread([k / bound for k, _ in pairs]),
    }


def _cell(value: dict[str, float]) -> str:
    return f"{value['median']} ({value['low']} to {value['high']})"


def main() -> None:
    """Measure all cases, print a table, write `results/inner_loop.json`."""
    torch.set_num_threads(1)
    results = {}
    print("| agent | kernel us/step | torch us/step | ratio | times the bound |")
    print("| --- | --- | --- | --- | --- |")
    with threadpool_limits(1):
        core = measure_core()
        for name, case in CASES.items():
            result = results[name] = measure(core, *case)
            cells = [_cell(result[key]) for key in ("kernel_us", "torch_us", "ratio", "over_bound")]
            print(f"| {name} | {' | '.join(cells)} |", flush=True)
    path = write_result(
        "inner_loop",
        "python -m benchmarks.speed.inner_loop",
        {
            "repeats": REPEATS,
            "unit": "microseconds per step, one core",
            "core": asdict(core),
            "results": results,
        },
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()

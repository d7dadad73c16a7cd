"""Time of one inner-loop step (environment step plus gradient step) of every built-in agent on an
SE: compiled kernel and torch definition in turn, in one process, on one core, and the kernel's
distance from the lower bound of its arithmetic (`bound`).

    python -m benchmarks.speed.inner_loop
"""

import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch

from benchmarks.machine import spread, write_result
from benchmarks.speed.bound import Core, measure_core, step_work
from bilevel.agents import get_agent
from bilevel.agents.agent import agent_seeds
from bilevel.agents.environments import KernelEnvironment
from bilevel.agents.training import train as train_in_python
from bilevel.evaluation.run import schedule
from bilevel.hyperparameters import AgentHyperparameters, SEHyperparameters, load_recipe
from bilevel.kernels import training
from bilevel.kernels.environment import environment
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import get_task
from bilevel.threads import one_blas_thread

REPEATS = 7
#: Approximate seconds of one measurement. Every step learns, and all episodes have equal length,
#: because the SE's done output is always negative.
SECONDS = 0.25
EPISODE_STEPS = 50


@dataclass(frozen=True)
class Case:
    """An agent and the SE that it trains on."""

    task_id: str
    agent: AgentHyperparameters
    se: SEHyperparameters


def cases() -> dict[str, Case]:
    """The cases by their labels. "optimized" are the paper's optimized hyperparameters for the
    task, "default" those of its default table; a label with sizes is the default with these. The
    last ones lie in the ranges of varied hyperparameters."""
    found = {
        "CartPole, DDQN, optimized": _case("CartPole-v0", "CartPole-v0", "ddqn"),
        "Acrobot, DDQN, optimized": _case("Acrobot-v1", "Acrobot-v1", "ddqn"),
        "CartPole, DDQN, default (2 x 128)": _case("CartPole-v0", "", "ddqn"),
        "CartPole, Dueling DDQN, default": _case("CartPole-v0", "", "dueling-ddqn"),
        "CartPole, TD3, default": _case("CartPole-v0", "", "td3"),
        "CartPole, DDQN, 1 x 42, batch 42": _sized(1, 42, 42),
        "CartPole, DDQN, 1 x 384": _sized(1, 384),
        "CartPole, DDQN, 3 x 384, batch 384": _sized(3, 384, 384),
    }
    for label, case in found.items():
        _assert_labelled(label, case)
    return found


def _case(task_id: str, column: str, agent: str) -> Case:
    """The case of the recipe `paper` for the task `column`; '' is the default table."""
    hp = load_recipe("paper", column, (agent,))
    return Case(task_id, hp.agents[0], hp.se)


def _sized(layers: int, size: int, batch_size: int | None = None) -> Case:
    """The default DDQN on CartPole with another network, and another batch size if given."""
    case = _case("CartPole-v0", "", "ddqn")
    changes: dict[str, Any] = {"hidden_layers": layers, "hidden_size": size}
    if batch_size is not None:
        changes["batch_size"] = batch_size
    return replace(case, agent=replace(case.agent, **changes))


def _assert_labelled(label: str, case: Case) -> None:
    """Check that a case has the hyperparameters that its label states."""
    task, agent, *sizes = label.split(", ")
    name = agent.lower().replace(" ", "-")
    assert case.task_id.startswith(f"{task}-"), label
    assert case.agent.agent == name, label
    column = case.task_id if sizes == ["optimized"] else ""
    recipe = load_recipe("paper", column, (name,))
    expected: Any = recipe.agents[0]
    if " x " in sizes[0]:
        layers, size = sizes[0].removeprefix("default (").removesuffix(")").split(" x ")
        shape = {"hidden_layers": int(layers), "hidden_size": int(size)}
        if sizes[0].startswith("default"):
            assert asdict(expected) == {**asdict(expected), **shape}, label
        expected = replace(expected, **shape)
    if sizes[1:]:
        expected = replace(expected, batch_size=int(sizes[1].removeprefix("batch ")))
    assert case.agent == expected, label
    assert case.se == recipe.se, label


def measure(core: Core, case: Case) -> dict[str, Any]:
    """Microseconds per step of both, their ratio over `REPEATS` pairs, and the bound."""
    task = get_task(case.task_id)
    hp: Any = replace(case.agent, init_episodes=0, early_out_episodes=10**6)
    architecture = Architecture.of(task, case.se)
    psi = architecture.initialize(np.random.default_rng(0)) * np.float32(0.3)
    se = SE(architecture, psi).kernel
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
    registered = get_agent(hp.agent)
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
    with one_blas_thread():
        core = measure_core()
        for label, case in cases().items():
            result = results[label] = measure(core, case)
            cells = [_cell(result[key]) for key in ("kernel_us", "torch_us", "ratio", "over_bound")]
            print(f"| {label} | {' | '.join(cells)} |", flush=True)
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

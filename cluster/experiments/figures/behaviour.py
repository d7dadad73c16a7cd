"""`behaviour`: transitions on an SE and on the real task (paper, Figure "histograms")."""

import io
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bilevel.agents import Transition
from bilevel.durable import write_aside
from bilevel.errors import InvalidInput
from bilevel.evaluation import record
from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import Task
from bilevel.tasks.names import observation_names
from cluster.experiments.agents import Evaluation, Plan, evaluations_on
from cluster.experiments.experiment import Experiment, Findings, Material
from cluster.experiments.sizes import Size
from cluster.experiments.style import SERIES, column, panels
from cluster.experiments.table import Row

#: Origins of the transitions, in the order of the looks.
TESTS = "real task, tests"
ORIGINS = ("SE, training", TESTS, "SE's answer to the real task")

#: Bins of a histogram, and the share of values at either end that may lie outside them.
_BINS, _OUTSIDE = 50, 0.002

Arrays = dict[str, NDArray[np.float32]]


def _runs(size: Size) -> dict[str, int]:
    return {"default": 1}


def _agents(plan: Plan, material: Material) -> list[Evaluation]:
    """Return agents of the first kind with default hyperparameters, as in the paper."""
    sources, agents = material.on("default"), plan.size.behaviour_agents
    return evaluations_on(plan, sources, plan.kinds[:1], agents, vary="no")


def _recorded(plan: Plan, material: Material, agents: Sequence[Evaluation]) -> Iterator[Arrays]:
    """Yield the transitions of each agent, which are stored in a file. Training runs in the
    agents' readable form on one core."""
    for done, agent in enumerate(agents):
        material.progress(done, len(agents))
        path = material.folder / f"transitions-{agent.key}.npz"
        if not path.exists():
            assert agent.source.se is not None
            made = record(plan.task, agent.source.se.se, agent.hp, agent.seed)
            size = plan.task.state_size
            arrays = {**columns("train", made.training, size), **columns("test", made.tests, size)}
            buffer = io.BytesIO()
            np.savez_compressed(buffer, allow_pickle=False, **arrays)
            write_aside(path, buffer.getvalue())
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            yield {name: file[name] for name in file.files}


def columns(name: str, transitions: Sequence[Transition], state_size: int) -> Arrays:
    """Return states (n, S), actions (n,), rewards (n,) and next states (n, S) of transitions."""

    def array(values: list[Any], *shape: int) -> NDArray[np.float32]:
        return np.array(values, np.float32).reshape(-1, *shape)  # also if there are none

    return {
        f"{name}_states": array([t.state for t in transitions], state_size),
        f"{name}_actions": array([t.action for t in transitions]),
        f"{name}_rewards": array([t.reward for t in transitions]),
        f"{name}_next": array([t.next_state for t in transitions], state_size),
    }


def _findings(plan: Plan, material: Material) -> Findings:
    agents = _agents(plan, material)
    hp, se = agents[0].hp, agents[0].source.se
    assert se is not None
    each = [*_recorded(plan, material, agents)]
    tested = sum(arrays["test_rewards"].size > 0 for arrays in each)  # which have not diverged
    if not tested:
        raise InvalidInput(
            f"all {len(agents)} agents diverged on the SE with seed {plan.seed}: there are no "
            "tests to show; use another --seed"
        )
    arrays = {name: np.concatenate([one[name] for one in each]) for name in each[0]}
    seen, names = _seen(arrays, se), _names(plan.task)
    data = densities(seen, names)
    episodes = tested * hp.test_episodes
    returns = float(arrays["test_rewards"].sum()) / episodes
    summary: list[Row] = []
    for origin, values in seen.items():
        row: dict[str, str | float | int | None] = {"seen": origin, "steps": len(values)}
        for name, value in zip(names, values.T, strict=True):
            row |= {name: float(value.mean()), f"{name}_std": float(value.std())}
        if origin == TESTS:
            row |= {"test_return": returns, "evaluations": episodes}
        summary.append(row)
    return Findings(
        data,
        summary,
        {"histograms": histograms(data, plan.task.id)},
        {"test_return": returns},
        (
            f"{len(agents)} {hp.agent} agents with the paper's default hyperparameters on the SE "
            f"with seed {plan.seed}, which was not selected. Their mean test return is "
            f"{returns:.1f}. {len(agents) - tested} agents diverged and have no tests. Values are "
            "next states and rewards.",
            f"The lowest and highest {_OUTSIDE:.1%} of the values may lie outside the histograms.",
        ),
    )


def _seen(arrays: Arrays, se: StoredSE) -> dict[str, NDArray[np.float32]]:
    """Return next states and rewards (n, S + 1) by origin."""
    states = torch.from_numpy(arrays["test_states"])
    actions = torch.from_numpy(arrays["test_actions"].astype(np.int64))
    following, rewards, _ = SEModule(se)(states, actions)
    parts = (
        (arrays["train_next"], arrays["train_rewards"]),
        (arrays["test_next"], arrays["test_rewards"]),
        (following.numpy(), rewards.numpy()),
    )
    return {origin: np.column_stack(part) for origin, part in zip(ORIGINS, parts, strict=True)}


def _names(task: Task) -> list[str]:
    return [*observation_names(task.id, task.state_size), "reward"]


def densities(seen: dict[str, NDArray[np.float32]], names: Sequence[str]) -> pd.DataFrame:
    """Return a row per value and bin: the bin's edges, and the share of steps by origin."""
    parts = []
    for i, name in enumerate(names):
        values = {origin: array[:, i] for origin, array in seen.items()}
        ends = [np.quantile(value, (_OUTSIDE, 1 - _OUTSIDE)) for value in values.values()]
        low, high = float(np.min(ends)), float(np.max(ends))
        if high - low < 1e-6:
            low, high = low - 0.5, high + 0.5
        edges = np.linspace(low, high, _BINS + 1)
        shares = {
            origin: np.histogram(value, edges)[0] / max(len(value), 1)
            for origin, value in values.items()
        }
        parts.append(pd.DataFrame({"value": name, "from": edges[:-1], "to": edges[1:], **shares}))
    return pd.concat(parts, ignore_index=True)


def histograms(data: pd.DataFrame, task_id: str) -> Figure:
    """Draw a panel per observation and one for the reward."""
    values = [*data.groupby("value", sort=False)]
    figure = column(0.5 + 1.1 * -(-len(values) // 2))
    drawn = panels(figure, len(values))
    for axes, (name, bins) in zip(drawn, values, strict=True):
        edges = [*bins["from"], bins["to"].iloc[-1]]
        for origin, look in zip(ORIGINS, SERIES, strict=False):
            axes.stairs(bins[origin], edges, color=look.colour, ls=look.line, lw=1.1)
            axes.stairs(bins[origin], edges, color=look.colour, fill=True, alpha=0.18)
        axes.set_yscale("symlog", linthresh=0.01)
        axes.set_ylim(0, 1)
        axes.set_xlabel(name)
    for origin, look in zip(ORIGINS, SERIES, strict=False):
        drawn[0].plot([], [], color=look.colour, ls=look.line, label=origin)
    figure.suptitle(task_id, fontsize=8)
    figure.supylabel("share of steps per bin (log, linear below 0.01)", fontsize=7.5)
    figure.legend(*drawn[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


BEHAVIOUR = Experiment(
    "behaviour",
    "Behaviour of an SE",
    "Next states and rewards of agents in training on one SE and in tests on the real task, and "
    "the SE's answers to the states and actions of these tests.",
    _runs,
    _findings,
)

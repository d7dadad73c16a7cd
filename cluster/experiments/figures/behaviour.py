"""`behaviour`: transitions on an SE and on the real task (paper, Figure "histograms")."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bilevel.agents import Transition
from bilevel.errors import InvalidInput
from bilevel.evaluation import record
from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.torch_module import SEModule
from cluster.evaluate.report import Row, Value
from cluster.experiments.experiment import Experiment, Findings, Material, Plan
from cluster.experiments.style import SERIES, panels

#: Origins of the transitions.
TESTS = "real task, tests"
ORIGINS = ("SE, training", TESTS, "SE's answer to the real task")

#: Bins of a histogram, and the share of values at either end that may lie outside them.
_BINS, _OUTSIDE = 50, 0.002


def _findings(plan: Plan, material: Material) -> Findings:
    """Record agents of the first kind with default hyperparameters, as in the paper."""
    sources, number = material.on("default"), plan.size.behaviour_agents
    agents = plan.evaluations(sources, plan.kinds[:1], number, vary="no")
    hp, se = agents[0].hp, agents[0].source.se
    assert se is not None
    recordings = []
    for done, agent in enumerate(agents):
        material.progress(done, len(agents))
        recordings.append(record(plan.task, se.se, agent.hp, agent.seed))
    tested = [tests for _, tests in recordings if tests]
    if not tested:
        raise InvalidInput(f"all agents diverged on the SE; use another --seed than {plan.seed}")
    seen = values_by_origin(
        [*chain(*(training for training, _ in recordings))], [*chain(*tested)], se
    )
    names = [*plan.task.labels.observations, "reward"]
    data = densities(seen, names)
    episodes = len(tested) * hp.test_episodes
    returns = float(seen[TESTS][:, -1].sum()) / episodes
    summary: list[Row] = []
    for origin, values in seen.items():
        row: dict[str, Value] = {"seen": origin, "steps": len(values)}
        for name, value in zip(names, values.T, strict=True):
            row |= {name: float(value.mean()), f"{name}_std": float(value.std())}
        if origin == TESTS:
            row |= {"test_return": returns, "evaluations": episodes}
        summary.append(row)
    note = (
        f"{len(agents)} {hp.agent} agents with the paper's default hyperparameters on the SE with "
        f"seed {plan.seed}. {len(agents) - len(tested)} agents diverged and have no tests. The "
        f"lowest and highest {_OUTSIDE:.1%} of the values may lie outside the histograms."
    )
    return Findings(
        data, summary, {"histograms": histograms(data)}, {"test_return": returns}, [note]
    )


def values_by_origin(
    training: Sequence[Transition], tests: Sequence[Transition], se: StoredSE
) -> dict[str, NDArray[np.float32]]:
    """Return next states and rewards (n, S + 1) by origin."""
    states = torch.from_numpy(np.array([step.state for step in tests], np.float32))
    actions = torch.from_numpy(np.array([step.action for step in tests], np.int64))
    following, rewards, _ = SEModule(se)(states, actions)
    answers = np.column_stack([following.numpy(), rewards.numpy()])
    on_se, on_task = (
        np.array([(*step.next_state, step.reward) for step in steps], np.float32)
        for steps in (training, tests)
    )
    return dict(zip(ORIGINS, (on_se, on_task, answers), strict=True))


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


def histograms(data: pd.DataFrame) -> Figure:
    """Draw a panel per observation and one for the reward."""
    figure, drawn = panels(data["value"].nunique(), 1.1)
    for axes, (name, bins) in zip(drawn, data.groupby("value", sort=False), strict=True):
        edges = [*bins["from"], bins["to"].iloc[-1]]
        for origin, colour in zip(ORIGINS, SERIES, strict=False):
            axes.stairs(bins[origin], edges, color=colour, label=origin)
        axes.set_yscale("symlog", linthresh=0.01)
        axes.set_ylim(0, 1)
        axes.set_xlabel(name)
    figure.supylabel("share of steps per bin (log, linear below 0.01)")
    figure.legend(*drawn[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


BEHAVIOUR = Experiment(
    "behaviour",
    "Behaviour of an SE",
    "Next states and rewards of agents in training on one SE and in tests on the real task, and "
    "the SE's answers to the states and actions of these tests.",
    lambda size: {"default": 1},
    _findings,
)

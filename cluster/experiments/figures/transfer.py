"""`transfer`: test returns of fresh agents, by what they were trained on (paper, the figures on
evaluation performance and on transfer)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from bilevel.agents.variation import VARIED
from bilevel.tasks import Task
from cluster.evaluate.report import Group
from cluster.experiments.agents import Place, Source, Unit
from cluster.experiments.authors import PICKED
from cluster.experiments.conditions import REAL, title_of
from cluster.experiments.experiment import Experiment, Findings, Material, Plan
from cluster.experiments.sizes import Size
from cluster.experiments.style import LOOKS, column, number, solved_line, violin
from cluster.experiments.table import Row, standard_error

#: What agents are trained on, in the order of the paper's violins, then ours.
SOURCES = (REAL, "varied", "fixed", "default")


def _runs(size: Size) -> dict[str, int]:
    return dict.fromkeys(("varied", "fixed", "default"), size.ses)


def units_on(plan: Plan, sources: Sequence[Source], kinds: slice = slice(None)) -> list[Unit]:
    """The agents on these sources: `agents` of each kind on an SE, `real_agents` on the real
    task."""
    size = plan.size
    found = []
    for source in sources:
        places = (
            Place.on_real(size.real_agents)
            if source.se is None
            else [Place(source.number, agent) for agent in range(size.agents)]
        )
        found += [
            Unit.of(plan.task, source, place, kind, plan.seed)
            for kind in plan.kinds[kinds]
            for place in places
        ]
    return found


def _units(plan: Plan, material: Material) -> list[Unit]:
    return [unit for name in SOURCES for unit in units_on(plan, material.of(name))]


def _findings(plan: Plan, material: Material) -> Findings:
    units = _units(plan, material)
    results = {unit.key: material.found[unit.key] for unit in units}
    groups: dict[tuple[str, str], list[Unit]] = {}
    for unit in units:
        groups.setdefault((unit.hp.agent, unit.source.condition), []).append(unit)
    as_groups = {
        place: Group(
            place[1],
            place[0],
            plan.task.solved_reward,
            tuple(results[unit.key] for unit in members),
        )
        for place, members in groups.items()
    }
    kinds = dict.fromkeys(agent for agent, _ in groups)
    return Findings(
        [agent_row(unit, material) for unit in units],
        [_summary(group, groups[place]) for place, group in as_groups.items()],
        {
            kind: violins(
                [as_groups[kind, name] for name in SOURCES],
                kind,
                plan.task,
                min(float(group.test_returns.min()) for group in as_groups.values()),
            )
            for kind in kinds
        },
        {
            f"test_return/{agent}/{name}": float(group.test_returns.mean())
            for (agent, name), group in as_groups.items()
        },
        (
            "The agents' learning rate, batch size and network are always drawn from the paper's "
            "ranges; agents at the same position are the same on every source.",
            "Test returns count each test episode, train steps and episodes each agent. The "
            f"{PICKED} best SEs are picked by the returns shown, as the authors did: such a "
            "number is too high for a new SE.",
            "The SE of every NES run counts, whether or not the run solved the task; the authors' "
            "SEs all come from runs that had.",
        ),
    )


def agent_row(unit: Unit, material: Material) -> Row:
    """An agent's line of the data: who it is, its hyperparameters, and how it did."""
    result, hp = material.found[unit.key], unit.hp
    return {
        "agent": hp.agent,
        "source": unit.source.condition,
        "se": None if unit.source.se is None else unit.source.number,
        "position": f"{unit.place.se}-{unit.place.agent}",
        **{name: getattr(hp, name, None) for name in VARIED},
        "score": result.score,
        "train_steps": result.train_steps,
        "train_episodes": result.train_episodes,
        "core_seconds": result.cost,
        **{f"return_{i}": value for i, value in enumerate(result.test_returns)},
    }


def _summary(group: Group, units: Sequence[Unit]) -> Row:
    s = group.summary()
    by_se: dict[int, list[float]] = {}
    for unit, result in zip(units, group.results, strict=True):
        by_se.setdefault(unit.source.number, []).append(result.score)
    means = sorted((float(np.mean(scores)) for scores in by_se.values()), reverse=True)
    return {
        "agent": group.agent,
        "source": group.source,
        "ses": None if group.source == REAL else len(by_se),
        "agents": len(units),
        "evaluations": group.test_returns.size,
        "test_return": s["test_returns_mean"],
        "test_return_std": s["test_returns_std"],
        "standard_error_over_ses": float(standard_error(np.array(means)))
        if len(means) > 1
        else None,
        "train_steps": s["train_steps_mean"],
        "train_steps_std": s["train_steps_std"],
        "train_steps_median": s["train_steps_median"],
        "train_episodes": s["train_episodes_mean"],
        "train_episodes_std": s["train_episodes_std"],
        "share_of_agents_solving": s["solved_fraction"],
        "five_best_ses": float(np.mean(means[:PICKED])) if len(means) > PICKED else None,
    }


def violins(groups: Sequence[Group], kind: str, task: Task, lowest: float) -> Figure:
    """Violins of test returns, on an axis from `lowest` on; the mean return above, train steps and
    episodes below."""
    figure = column(3.0)
    axes = figure.subplots()
    for x, group in enumerate(groups):
        returns = group.test_returns
        violin(axes, x, returns, LOOKS[group.source])
        axes.annotate(
            number(returns.mean(), ".1f"),
            (x, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
        )
    solved_line(axes, task.solved_reward)
    axes.set_ylabel(f"test return on {task.id}")
    axes.set_xlim(-0.6, len(groups) - 0.4)
    highest = max(float(group.test_returns.max()) for group in groups)
    low, high = min(lowest, task.solved_reward), max(highest, task.solved_reward)
    margin = 0.05 * max(high - low, 1.0)
    axes.set_ylim(low - margin, high + margin)
    axes.set_xticks(range(len(groups)), [_below(group) for group in groups], fontsize=5.8)
    axes.set_title(f"{kind} (above: mean)", pad=11)
    return figure


def _below(group: Group) -> str:
    steps, episodes = group.train_steps, group.train_episodes
    return "\n".join(
        (
            title_of(group.source),
            f"{len(group.results)} agents",
            "train steps",
            f"{steps.mean():.0f} ± {steps.std():.0f}",
            "episodes",
            f"{episodes.mean():.0f} ± {episodes.std():.0f}",
        )
    )


TRANSFER = Experiment(
    "transfer",
    "Performance and transfer of agents",
    "Test returns on the real task of fresh agents that were trained on the real task, and on SEs "
    "that NES learned with DDQN alone. Bars are quartiles, white dots medians, diamonds means, and "
    "the dotted line is the return that solves the task.",
    _runs,
    _findings,
    _units,
    agents={
        "CartPole-v0": ("ddqn", "dueling-ddqn", "td3"),
        "Acrobot-v1": ("ddqn", "dueling-ddqn"),
    },
    usual_agents=("ddqn", "dueling-ddqn"),
)

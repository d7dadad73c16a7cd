"""`behaviour`: what agents see on an SE and on the real task (paper, Figure "histograms")."""

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
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
from cluster.experiments.agents import Place, Unit
from cluster.experiments.experiment import Experiment, Findings, Material, Plan
from cluster.experiments.sizes import Size
from cluster.experiments.style import SERIES, column
from cluster.experiments.table import Row

#: What histograms are drawn of, in the order of the looks.
TESTS = "real task, tests"
ORIGINS = ("SE, training", TESTS, "SE's answer to the real task")

#: Bins of a histogram, and the share of values at either end that may lie outside them.
_BINS, _OUTSIDE = 50, 0.002

Arrays = dict[str, NDArray[np.float32]]


def _runs(size: Size) -> dict[str, int]:
    return {"default": 1}


def _agents(plan: Plan, material: Material) -> list[Unit]:
    """Agents of the first kind with default hyperparameters, as in the paper."""
    (source,) = material.of("default")
    return [
        Unit.of(plan.task, source, Place(0, agent), plan.kinds[0], plan.seed, vary="no")
        for agent in range(plan.size.behaviour_agents)
    ]


def _file(folder: Path, unit: Unit) -> Path:
    return folder / f"transitions-{unit.key}.npz"


def _record(plan: Plan, material: Material, progress: Callable[[int, int], None]) -> None:
    units = _agents(plan, material)
    for done, unit in enumerate(units):
        progress(done, len(units))
        path = _file(material.folder, unit)
        if not path.exists():
            assert unit.source.se is not None
            made = record(plan.task, unit.source.se.se, unit.hp, unit.seed)
            size = plan.task.state_size
            arrays = {**columns("train", made.training, size), **columns("test", made.tests, size)}
            write_aside(path, _npz(arrays))
    progress(len(units), len(units))


def columns(name: str, transitions: Sequence[Transition], state_size: int) -> Arrays:
    """Transitions as arrays: states (n, S), actions (n,), rewards (n,), next states (n, S)."""
    return {
        f"{name}_states": _array([t.state for t in transitions], state_size),
        f"{name}_actions": _array([t.action for t in transitions]),
        f"{name}_rewards": _array([t.reward for t in transitions]),
        f"{name}_next": _array([t.next_state for t in transitions], state_size),
    }


def _array(values: Sequence[Any], *shape: int) -> NDArray[np.float32]:
    """Values as (n, *shape), also if there are none."""
    return np.array(values, np.float32).reshape(-1, *shape)


def _npz(arrays: Arrays) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _loaded(path: Path) -> Arrays:
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:  # numpy, zipfile and zlib each raise their own
        raise InvalidInput(f"damaged file {str(path)!r}: {error}; delete it") from None


def _findings(plan: Plan, material: Material) -> Findings:
    units = _agents(plan, material)
    se = units[0].source.se
    assert se is not None
    each = [_loaded(_file(material.folder, unit)) for unit in units]
    tested = sum(one["test_rewards"].size > 0 for one in each)  # agents that have not diverged
    if not tested:
        raise InvalidInput(
            f"all {len(units)} agents have diverged on the SE with seed {plan.seed}: there are no "
            "tests to show; take another --seed"
        )
    arrays = {name: np.concatenate([one[name] for one in each]) for name in each[0]}
    seen = _seen(arrays, se)
    rows: list[Row] = []
    summary: list[Row] = []
    figure = histograms(seen, _names(plan.task), plan.task.id, rows)
    episodes = tested * units[0].hp.test_episodes
    returns = float(arrays["test_rewards"].sum()) / episodes
    for origin, values in seen.items():
        row: dict[str, str | float | int | None] = {"seen": origin, "steps": len(values)}
        for name, column_of in zip(_names(plan.task), values.T, strict=True):
            row |= {name: float(column_of.mean()), f"{name}_std": float(column_of.std())}
        if origin == TESTS:
            row |= {"test_return": returns, "evaluations": episodes}
        summary.append(row)
    return Findings(
        rows,
        summary,
        {"histograms": figure},
        {"test_return": returns},
        (
            f"{len(units)} {units[0].hp.agent} agents with the paper's default hyperparameters on "
            f"the SE with seed {plan.seed}, which was not chosen; their mean test return is "
            f"{returns:.1f}. Values are next states and rewards."
            + ("" if tested == len(units) else f" {len(units) - tested} diverged, without tests."),
            f"At most the lowest and highest {_OUTSIDE:.1%} of the values are outside the "
            "histograms.",
        ),
    )


def _seen(arrays: Arrays, se: StoredSE) -> dict[str, NDArray[np.float32]]:
    """Next states and rewards (n, S + 1) by origin."""
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


def histograms(
    seen: dict[str, NDArray[np.float32]], names: Sequence[str], task_id: str, rows: list[Row]
) -> Figure:
    """A panel for each next state and for the reward; appends the densities to `rows`."""
    panels = -(-len(names) // 2)
    figure = column(0.5 + 1.1 * panels)
    drawn: list[Axes] = list(figure.subplots(panels, 2).flat)
    for i, (axes, name) in enumerate(zip(drawn, names, strict=False)):
        values = {origin: array[:, i] for origin, array in seen.items()}
        ends = [np.quantile(one, (_OUTSIDE, 1 - _OUTSIDE)) for one in values.values()]
        low, high = float(np.min(ends)), float(np.max(ends))
        if high - low < 1e-6:
            low, high = low - 0.5, high + 0.5
        edges = np.linspace(low, high, _BINS + 1)
        densities = {}
        for (origin, one), look in zip(values.items(), SERIES, strict=False):
            inside, _ = np.histogram(one, edges)
            densities[origin] = inside / max(len(one), 1)
            axes.stairs(densities[origin], edges, color=look.colour, ls=look.line, lw=1.1)
            axes.stairs(densities[origin], edges, color=look.colour, fill=True, alpha=0.18)
        for k in range(_BINS):
            shares = {origin: float(density[k]) for origin, density in densities.items()}
            rows.append({"value": name, "from": edges[k], "to": edges[k + 1], **shares})
        axes.set_yscale("symlog", linthresh=0.01)
        axes.set_ylim(0, 1)
        axes.set_xlabel(name)
    for axes in drawn[len(names) :]:
        axes.set_visible(False)
    for look, origin in zip(SERIES, seen, strict=False):
        drawn[0].plot([], [], color=look.colour, ls=look.line, label=origin)
    figure.suptitle(task_id, fontsize=8)
    figure.supylabel("share of steps per bin (log, linear below 0.01)", fontsize=7.5)
    figure.legend(*drawn[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


BEHAVIOUR = Experiment(
    "behaviour",
    "Behaviour of an SE",
    "Next states and rewards that agents meet while they train on one SE, that they meet in tests "
    "on the real task afterwards, and with which the SE answers the states and actions of these "
    "tests.",
    _runs,
    _findings,
    record=_record,
)

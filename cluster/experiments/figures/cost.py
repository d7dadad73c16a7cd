"""`cost`: what making an SE takes, and after how many agents that is paid back."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from cluster.experiments.agents import Unit
from cluster.experiments.conditions import REAL
from cluster.experiments.experiment import Experiment, Findings, Material, Plan
from cluster.experiments.figures.transfer import units_on
from cluster.experiments.sizes import Size
from cluster.experiments.style import LOOKS, column
from cluster.experiments.table import Row


@dataclass(frozen=True)
class Cost:
    """What one way of training agents costs, in real steps or in core seconds: once, and for each
    agent."""

    fixed: float
    marginal: float

    def break_even(self, other: "Cost") -> float | None:
        """Number of agents from which this way is as cheap as the other; None if it never is."""
        if other.marginal <= self.marginal:
            return None
        return max(self.fixed - other.fixed, 0.0) / (other.marginal - self.marginal)


@dataclass(frozen=True)
class SECost:
    """The costs of one SE."""

    number: int
    steps: Cost
    core: Cost
    test_return: float  # mean of the agents trained on it


def _runs(size: Size) -> dict[str, int]:
    return {"default": size.ses}


def _units(plan: Plan, material: Material) -> list[Unit]:
    sources = [*material.of("default"), *material.of(REAL)]
    return units_on(plan, sources, slice(1))


def _findings(plan: Plan, material: Material) -> Findings:
    found, units = material.found, _units(plan, material)
    real = [found[unit.key] for unit in units if unit.source.se is None]
    steps = Cost(0.0, float(np.mean([one.train_steps for one in real])))
    core = Cost(0.0, float(np.mean([one.cost for one in real])))
    costs = []
    for made, source in zip(material.ses, material.sources, strict=True):
        assert source.se is not None
        taught = [found[unit.key] for unit in units if unit.source is source]
        costs.append(
            SECost(
                made.number,
                Cost(float(source.se.info["real_env_steps"]), 0.0),
                Cost(made.state.cost, float(np.mean([one.cost for one in taught]))),
                float(np.mean([one.score for one in taught])),
            )
        )
    rows = [_row(cost, steps, core) for cost in costs]
    return Findings(
        rows,
        [_median(rows), *rows],
        {"payback": payback(costs, steps, core, f"{plan.kinds[0].agent} on {plan.task.id}")},
        {
            "real_env_steps": float(np.median([cost.steps.fixed for cost in costs])),
            "real_train_steps_of_an_agent": steps.marginal,
        },
        (
            f"{len(real)} {plan.kinds[0].agent} agents on the real task train for "
            f"{steps.marginal:.0f} steps and {core.marginal:.1f} core seconds on average; on an SE "
            "an agent makes no real step before its tests.",
            "Real steps of making an SE are all that its run made: tests of every evaluation, the "
            "scale of observations, and the last tests. Core seconds are estimated from training "
            "steps, real steps and network sizes, and leave out the retest at the end.",
        ),
    )


def _row(cost: SECost, steps: Cost, core: Cost) -> Row:
    return {
        "se": str(cost.number),
        "real_steps_to_make_it": round(cost.steps.fixed),
        "paid_back_in_real_steps_after_agents": cost.steps.break_even(steps),
        "core_seconds_to_make_it": cost.core.fixed,
        "core_seconds_of_an_agent": cost.core.marginal,
        "paid_back_in_core_time_after_agents": cost.core.break_even(core),
        "test_return": cost.test_return,
    }


def _median(rows: Sequence[Row]) -> Row:
    """The median of each column; an SE that never pays back counts as the largest."""
    medians: dict[str, str | float | int | None] = {"se": "median"}
    for name in list(rows[0])[1:]:
        numbers = [np.inf if (value := row[name]) is None else float(value) for row in rows]
        middle = float(np.median(numbers))
        medians[name] = middle if np.isfinite(middle) else None
    return medians


def payback(costs: Sequence[SECost], steps: Cost, core: Cost, what: str) -> Figure:
    """Cumulated cost over the number of agents, on the real task and on SEs."""
    figure = column(3.6)
    above, below = figure.subplots(2, 1)
    _panel(above, [cost.steps for cost in costs], steps)
    above.set_ylabel("real steps in all")
    above.set_title(f"{what}; dots: an SE is paid back")
    _panel(below, [cost.core for cost in costs], core)
    below.set_ylabel("core time in all (s)")
    below.yaxis.set_major_locator(LogLocator(subs=(1, 3)))
    below.yaxis.set_major_formatter("{x:g}")
    below.yaxis.set_minor_locator(NullLocator())
    for axes in (above, below):
        axes.set_xlabel("agents trained")
    figure.legend(*below.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _panel(axes: Axes, costs: Sequence[Cost], real: Cost) -> None:
    paid = [cost.break_even(real) for cost in costs]
    last = 3 * max([10.0, *(one for one in paid if one is not None)])
    agents = np.geomspace(1, last, 60)
    ours, theirs = LOOKS["default"], LOOKS[REAL]
    for cost, at in zip(costs, paid, strict=True):
        axes.plot(agents, cost.fixed + cost.marginal * agents, color=ours.colour, lw=0.5, alpha=0.6)
        if at is not None and at >= 1:
            axes.plot([at], [real.marginal * at], marker=ours.marker, color=ours.colour, ls="none")
    middle = np.median([cost.fixed + cost.marginal * agents for cost in costs], axis=0)
    axes.plot(agents, middle, color=ours.colour, ls=ours.line, label="SEs (thick: median)")
    axes.plot(
        agents, real.marginal * agents, color=theirs.colour, ls=theirs.line, label="real task"
    )
    axes.set_xscale("log")
    axes.set_yscale("log")


COST = Experiment(
    "cost",
    "Cost of an SE",
    "The real environment steps and the core time that making an SE takes, against those of "
    "training agents on the real task.",
    _runs,
    _findings,
    _units,
)

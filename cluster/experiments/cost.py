"""`cost`: what making an SE takes, and after how many agents that is paid back."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cluster.experiments.agents import Unit
from cluster.experiments.conditions import REAL
from cluster.experiments.experiment import Experiment, Findings, Material, Plan
from cluster.experiments.sizes import Size
from cluster.experiments.style import LOOKS, column
from cluster.experiments.table import Row
from cluster.experiments.transfer import units_on


@dataclass(frozen=True)
class Bill:
    """What one way of training agents costs, in real steps or in core seconds: once, and for each
    agent."""

    once: float
    each: float

    def paid_back(self, other: "Bill") -> float | None:
        """Number of agents from which this way is as cheap as the other; None if it never is."""
        if other.each <= self.each:
            return None
        return max(self.once - other.once, 0.0) / (other.each - self.each)


@dataclass(frozen=True)
class SECost:
    """The bills of one SE."""

    number: int
    steps: Bill
    core: Bill
    test_return: float  # mean of the agents trained on it


def _runs(size: Size) -> dict[str, int]:
    return {"default": size.ses}


def _units(plan: Plan, material: Material) -> list[Unit]:
    sources = [*material.of("default"), *material.of(REAL)]
    return units_on(plan, sources, slice(1))


def _findings(plan: Plan, material: Material) -> Findings:
    found, units = material.found, _units(plan, material)
    real = [found[unit.key] for unit in units if unit.source.se is None]
    steps = Bill(0.0, float(np.mean([one.train_steps for one in real])))
    core = Bill(0.0, float(np.mean([one.cost for one in real])))
    costs = []
    for made, source in zip(material.ses, material.sources, strict=True):
        assert source.se is not None
        taught = [found[unit.key] for unit in units if unit.source is source]
        costs.append(
            SECost(
                made.number,
                Bill(float(source.se.info["real_env_steps"]), 0.0),
                Bill(made.state.cost, float(np.mean([one.cost for one in taught]))),
                float(np.mean([one.score for one in taught])),
            )
        )
    rows = [_row(cost, steps, core) for cost in costs]
    return Findings(
        rows,
        [_median(rows), *rows],
        {"payback": payback(costs, steps, core, plan.kinds[0].agent)},
        {
            "real_env_steps": float(np.median([cost.steps.once for cost in costs])),
            "real_train_steps_of_an_agent": steps.each,
        },
        (
            f"{len(real)} {plan.kinds[0].agent} agents on the real task train for {steps.each:.0f} "
            f"steps and {core.each:.1f} core seconds on average; on an SE an agent makes no real "
            "step before its tests.",
            "Real steps of making an SE are all that its run made: tests of every evaluation, the "
            "scale of observations, and the last tests. Core seconds are estimated from gradient "
            "steps, real steps and network sizes, and leave out the retest at the end.",
        ),
    )


def _row(cost: SECost, steps: Bill, core: Bill) -> Row:
    return {
        "se": str(cost.number),
        "real_steps_to_make_it": round(cost.steps.once),
        "paid_back_in_real_steps_after_agents": cost.steps.paid_back(steps),
        "core_seconds_to_make_it": cost.core.once,
        "core_seconds_of_an_agent": cost.core.each,
        "paid_back_in_core_time_after_agents": cost.core.paid_back(core),
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


def payback(costs: Sequence[SECost], steps: Bill, core: Bill, kind: str) -> Figure:
    """Cumulated cost over the number of agents, on the real task and on SEs."""
    figure = column(3.6)
    above, below = figure.subplots(2, 1)
    _panel(above, [cost.steps for cost in costs], steps)
    above.set_ylabel("real steps in all")
    above.set_title(f"{kind}: dots, where an SE is paid back")
    _panel(below, [cost.core for cost in costs], core)
    below.set_ylabel("core time in all (s)")
    below.set_xlabel("agents trained")
    figure.legend(*below.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _panel(axes: Axes, bills: Sequence[Bill], real: Bill) -> None:
    paid = [bill.paid_back(real) for bill in bills]
    last = 3 * max([10.0, *(one for one in paid if one is not None)])
    agents = np.geomspace(1, last, 60)
    ours, theirs = LOOKS["default"], LOOKS[REAL]
    for bill, at in zip(bills, paid, strict=True):
        axes.plot(agents, bill.once + bill.each * agents, color=ours.colour, lw=0.5, alpha=0.6)
        if at is not None and at >= 1:
            axes.plot([at], [real.each * at], marker=ours.marker, color=ours.colour, ls="none")
    middle = np.median([bill.once + bill.each * agents for bill in bills], axis=0)
    axes.plot(agents, middle, color=ours.colour, ls=ours.line, label="SEs (thick: median)")
    axes.plot(agents, real.each * agents, color=theirs.colour, ls=theirs.line, label="real task")
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

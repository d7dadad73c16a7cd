"""`cost`: the cost of making an SE, and the number of agents after which it pays off."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from cluster.experiments.agents import Evaluation, Plan, evaluations_on
from cluster.experiments.conditions import REAL
from cluster.experiments.experiment import Experiment, Findings, Material
from cluster.experiments.figures.transfer import agent_data
from cluster.experiments.sizes import Size
from cluster.experiments.style import LOOKS, column, legend_below
from cluster.experiments.table import Row


@dataclass(frozen=True)
class Cost:
    """Cost of training agents in one environment, in real steps or in core seconds."""

    fixed: float  # of making the environment
    marginal: float  # of each agent

    def break_even(self, other: "Cost") -> float | None:
        """Return the number of agents from which this cost is at most the other; None if never."""
        if other.marginal <= self.marginal:
            return None
        return max(self.fixed - other.fixed, 0.0) / (other.marginal - self.marginal)


def _runs(size: Size) -> dict[str, int]:
    return {"default": size.ses}


def _evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    sources, size = material.on("default", REAL), plan.size
    return evaluations_on(plan, sources, plan.kinds[:1], size.agents, size.real_agents)


def _findings(plan: Plan, material: Material) -> Findings:
    data = agent_data(_evaluations(plan, material), material)
    agents = data.groupby(["source", "se"], dropna=False)
    means = {key: rows[["train_steps", "core_seconds", "score"]].mean() for key, rows in agents}
    (real,) = (mean for (source, _), mean in means.items() if source == REAL)
    real_steps, real_core = Cost(0.0, real["train_steps"]), Cost(0.0, real["core_seconds"])
    rows: list[Row] = []
    steps, core = [], []
    for made, source in zip(material.ses, material.sources, strict=True):
        assert source.se is not None
        mean = means["default", made.number]
        steps.append(Cost(float(source.se.info["real_env_steps"]), 0.0))
        core.append(Cost(made.state.cost, mean["core_seconds"]))
        rows.append(
            {
                "se": str(made.number),
                "real_steps_to_make_it": round(steps[-1].fixed),
                "paid_back_in_real_steps_after_agents": steps[-1].break_even(real_steps),
                "core_seconds_to_make_it": core[-1].fixed,
                "core_seconds_of_an_agent": core[-1].marginal,
                "paid_back_in_core_time_after_agents": core[-1].break_even(real_core),
                "test_return": mean["score"],
            }
        )
    name = f"{plan.kinds[0].agent} on {plan.task.id}"
    return Findings(
        pd.DataFrame(rows, dtype=object),
        [_median(rows), *rows],
        {"payback": payback(steps, real_steps, core, real_core, name)},
        {
            "real_env_steps": float(np.median([cost.fixed for cost in steps])),
            "real_train_steps_of_an_agent": real_steps.marginal,
        },
        (
            f"{plan.size.real_agents} {plan.kinds[0].agent} agents on the real task train for "
            f"{real_steps.marginal:.0f} steps and {real_core.marginal:.1f} core seconds on "
            "average. On an SE an agent makes no real step before its tests.",
            "Real steps of making an SE are all steps of its run: tests of every evaluation, the "
            "scale of observations, and the last tests. Core seconds are estimated from training "
            "steps, real steps and network sizes, and exclude the retest at the end.",
        ),
    )


def _median(rows: Sequence[Row]) -> Row:
    """Return the median of each column; an SE that never pays off counts as infinite."""
    columns = pd.DataFrame(rows).set_index("se").astype(float).fillna(np.inf)
    medians = {name: float(np.median(columns[name])) for name in columns}
    finite = {name: value if np.isfinite(value) else None for name, value in medians.items()}
    return {"se": "median", **finite}


def payback(
    steps: Sequence[Cost], real_steps: Cost, core: Sequence[Cost], real_core: Cost, name: str
) -> Figure:
    """Draw the cumulative costs over the number of agents, on the real task and on SEs."""
    figure = column(3.6)
    above, below = figure.subplots(2, 1)
    _panel(above, steps, real_steps)
    above.set_ylabel("real steps in all")
    above.set_title(f"{name}; dots: an SE is paid back")
    _panel(below, core, real_core)
    below.set_ylabel("core time in all (s)")
    below.yaxis.set_major_locator(LogLocator(subs=(1, 3)))
    below.yaxis.set_major_formatter("{x:g}")
    below.yaxis.set_minor_locator(NullLocator())
    for axes in (above, below):
        axes.set_xlabel("agents trained")
    legend_below(below)
    return figure


def _panel(axes: Axes, costs: Sequence[Cost], real: Cost) -> None:
    paid = [cost.break_even(real) for cost in costs]
    last = 3 * max([10.0, *(agents for agents in paid if agents is not None)])
    agents = np.geomspace(1, last, 60)
    ours, task = LOOKS["default"], LOOKS[REAL]
    totals = [cost.fixed + cost.marginal * agents for cost in costs]
    for total, at in zip(totals, paid, strict=True):
        axes.plot(agents, total, color=ours.colour, lw=0.5, alpha=0.6)
        if at is not None and at >= 1:
            axes.plot([at], [real.marginal * at], marker=ours.marker, color=ours.colour, ls="none")
    median = np.median(totals, axis=0)
    axes.plot(agents, median, color=ours.colour, ls=ours.line, label="SEs (thick: median)")
    axes.plot(agents, real.marginal * agents, color=task.colour, ls=task.line, label="real task")
    axes.set_xscale("log")
    axes.set_yscale("log")


COST = Experiment(
    "cost",
    "Cost of an SE",
    "Real environment steps and core time of making an SE, compared with those of training agents "
    "on the real task.",
    _runs,
    _findings,
    _evaluations,
)

"""`cost`: the cost of making an SE, and the number of agents after which it pays off."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from cluster.experiments.agents import Evaluation, Plan, evaluations_on
from cluster.experiments.conditions import REAL
from cluster.experiments.experiment import Experiment, Findings, Material
from cluster.experiments.style import LOOKS, column, legend_below


def _evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    sources, size = material.on("default", REAL), plan.size
    return evaluations_on(plan, sources, plan.kinds[:1], size.agents, size.real_agents)


def break_even(cost: float, saved: float) -> float | None:
    """Return the number of agents after which an SE that costs `cost` pays off if each agent saves
    `saved`; None if never."""
    return cost / saved if saved > 0 else None


def _findings(plan: Plan, material: Material) -> Findings:
    agents = material.agents(_evaluations(plan, material))
    columns = ["train_steps", "core_seconds", "score"]
    on_real = agents[agents["source"] == REAL][columns].mean()
    on_ses = agents[agents["source"] != REAL].groupby("se", sort=False)
    rows = []
    for source, (_, on_se) in zip(material.sources, on_ses, strict=True):
        assert source.se is not None
        steps, core = source.se.info["real_env_steps"], source.state.cost
        mean = on_se[columns].mean()
        rows.append(
            {
                "se": str(source.number),
                "real_steps_to_make_it": steps,
                "paid_back_in_real_steps_after_agents": break_even(steps, on_real["train_steps"]),
                "core_seconds_to_make_it": core,
                "core_seconds_of_an_agent": mean["core_seconds"],
                "paid_back_in_core_time_after_agents": break_even(
                    core, on_real["core_seconds"] - mean["core_seconds"]
                ),
                "test_return": mean["score"],
            }
        )
    data = pd.DataFrame(rows, dtype=object)  # columns of integers remain integers
    # An SE that never pays off counts as infinite.
    medians = data.drop(columns="se").astype(float).fillna(np.inf).median()
    median = {name: value if np.isfinite(value) else None for name, value in medians.items()}
    kind = plan.kinds[0].agent
    return Findings(
        data,
        [{"se": "median", **median}, *rows],
        {"payback": payback(data, on_real, f"{kind} on {plan.task.id}")},
        {
            "real_env_steps": medians["real_steps_to_make_it"],
            "real_train_steps_of_an_agent": on_real["train_steps"],
        },
        (
            f"{plan.size.real_agents} {kind} agents on the real task train for "
            f"{on_real['train_steps']:.0f} steps and {on_real['core_seconds']:.1f} core seconds "
            "on average. On an SE an agent makes no real step before its tests.",
            "Real steps of making an SE are all steps of its run: tests of every evaluation, the "
            "scale of observations, and the last tests. Core seconds are estimated from training "
            "steps, real steps and network sizes, and exclude the retest at the end.",
        ),
    )


def payback(data: pd.DataFrame, on_real: pd.Series, name: str) -> Figure:
    """Draw the cumulative costs over the number of agents, on the real task and on SEs."""
    figure = column(3.6)
    above, below = figure.subplots(2, 1)
    steps = data["real_steps_to_make_it"], data["paid_back_in_real_steps_after_agents"]
    _panel(above, *steps, pd.Series(0.0, data.index), on_real["train_steps"])
    above.set_ylabel("real steps in all")
    above.set_title(f"{name}; dots: an SE is paid back")
    core = data["core_seconds_to_make_it"], data["paid_back_in_core_time_after_agents"]
    _panel(below, *core, data["core_seconds_of_an_agent"], on_real["core_seconds"])
    below.set_ylabel("core time in all (s)")
    below.yaxis.set_major_locator(LogLocator(subs=(1, 3)))
    below.yaxis.set_major_formatter("{x:g}")
    below.yaxis.set_minor_locator(NullLocator())
    for axes in (above, below):
        axes.set_xlabel("agents trained")
    legend_below(below)
    return figure


def _panel(axes: Axes, costs: pd.Series, paid: pd.Series, marginal: pd.Series, real: float) -> None:
    """Draw the costs of SEs with their marginal costs of an agent, and the real task's."""
    agents = np.geomspace(1, 3 * max([10.0, *paid.dropna()]), 60)
    ours, task = LOOKS["default"], LOOKS[REAL]
    totals = [cost + each * agents for cost, each in zip(costs, marginal, strict=True)]
    for total, at in zip(totals, paid, strict=True):
        axes.plot(agents, total, color=ours.colour, lw=0.5, alpha=0.6)
        if at is not None and at >= 1:
            axes.plot([at], [real * at], marker=ours.marker, color=ours.colour, ls="none")
    median = np.median(totals, axis=0)
    axes.plot(agents, median, color=ours.colour, ls=ours.line, label="SEs (thick: median)")
    axes.plot(agents, real * agents, color=task.colour, ls=task.line, label="real task")
    axes.set_xscale("log")
    axes.set_yscale("log")


COST = Experiment(
    "cost",
    "Cost of an SE",
    "Real environment steps and core time of making an SE, compared with the training of agents on "
    "the real task.",
    lambda size: {"default": size.ses},
    _findings,
    _evaluations,
)

"""`cost`: the cost of making an SE, and the number of agents after which it pays off."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cluster.experiments.conditions import REAL
from cluster.experiments.experiment import Evaluation, Experiment, Findings, Material, Plan
from cluster.experiments.style import COLOURS, column


def _evaluations(plan: Plan, material: Material) -> list[Evaluation]:
    sources, size = material.on("default", REAL), plan.size
    return plan.evaluations(sources, plan.kinds[:1], size.agents, size.real_agents)


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
        saved = on_real - mean
        rows.append(
            {
                "se": str(source.number),
                "real_steps_to_make_it": steps,
                "paid_back_in_real_steps_after_agents": break_even(steps, on_real["train_steps"]),
                "core_seconds_to_make_it": core,
                "core_seconds_of_an_agent": mean["core_seconds"],
                "paid_back_in_core_time_after_agents": break_even(core, saved["core_seconds"]),
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
        {"payback": payback(data, on_real["train_steps"], f"{kind} on {plan.task.id}")},
        {
            "real_env_steps": medians["real_steps_to_make_it"],
            "real_train_steps_of_an_agent": on_real["train_steps"],
        },
        (
            f"{plan.size.real_agents} {kind} agents on the real task train for "
            f"{on_real['train_steps']:.0f} steps and {on_real['core_seconds']:.1f} core seconds "
            "on average. On an SE an agent makes no real step before its tests.",
            "Core seconds are estimated from training steps, real steps and network sizes, and "
            "exclude the retest at the end.",
        ),
    )


def payback(data: pd.DataFrame, steps_of_an_agent: float, name: str) -> Figure:
    """Draw the real steps over the number of agents: constant on SEs, growing on the real task."""
    figure = column(2.3)
    axes = figure.subplots()
    costs = data["real_steps_to_make_it"].astype(float)
    agents = np.geomspace(1, 3 * max(10.0, costs.max() / steps_of_an_agent), 60)
    axes.hlines(costs, 1, agents[-1], color=COLOURS["default"], lw=0.7, label="SEs")
    axes.plot(agents, steps_of_an_agent * agents, color=COLOURS[REAL], label="real task")
    axes.set(xscale="log", yscale="log", xlabel="agents trained", ylabel="real steps in all")
    axes.legend()
    axes.set_title(name)
    return figure


COST = Experiment(
    "cost",
    "Cost of an SE",
    "Real environment steps and core time of making an SE, compared with the training of agents on "
    "the real task.",
    lambda size: {"default": size.ses},
    _findings,
    _evaluations,
)

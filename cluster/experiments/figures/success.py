"""`success`: scores over the generations of many NES runs (paper, Figure "success")."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, NullFormatter
from numpy.typing import NDArray

from bilevel.tasks import Task
from cluster.experiments.agents import Plan
from cluster.experiments.conditions import title_of
from cluster.experiments.experiment import Experiment, Findings, Material
from cluster.experiments.style import LOOKS, column, legend_below, solved_line
from cluster.experiments.table import Row
from cluster.session.terminal import count
from cluster.storage.run_folder import finals

Floats = NDArray[np.float64]


def _findings(plan: Plan, material: Material) -> Findings:
    curves, ends = [], []
    for source in material.sources:
        assert source.run is not None
        state, condition = source.state, source.condition
        for generation, record in enumerate(state.records):
            curves.append(
                {
                    "condition": condition,
                    "seed": source.run.seed,
                    "generation": generation,
                    "score": record.score_mean,
                    "core_seconds": record.cost,
                    "update_norm": record.update_norm,
                }
            )
        score = finals(source.run.folder)[-1].metrics["final_score_mean"]
        ends.append({"condition": condition, "core_seconds": state.cost, "final_score": score})
    return findings_of(pd.DataFrame(curves), pd.DataFrame(ends), plan.task)


def scores_by_run(curves: pd.DataFrame) -> Floats:
    """Return the scores (runs, G) of one condition. A run keeps its last score after its end."""
    scores = curves.pivot(index="seed", columns="generation", values="score")
    return np.ascontiguousarray(scores.ffill(axis="columns").to_numpy())


def first_solved(curves: pd.DataFrame, solved_reward: float) -> pd.DataFrame:
    """Return the first generation of each run whose score solves the task."""
    return curves[curves["score"] >= solved_reward].groupby("seed").first()


def findings_of(data: pd.DataFrame, ends: pd.DataFrame, task: Task) -> Findings:
    """Return table and pictures of runs.

    `data` has a row per generation: score of the unperturbed SE, core seconds since the start, and
    length of the step on the mean. `ends` has a row per run: core seconds including the last
    confirmation, and the score of fresh agents on the best SE.
    """
    curves = dict([*data.groupby("condition", sort=False)])
    summary = [
        _summary(name, group, ends[ends["condition"] == name], task.solved_reward)
        for name, group in curves.items()
    ]
    return Findings(
        data,
        summary,
        {"curves": _curves(curves, task), "share": _shares(curves, task)},
        {f"share_solved/{row['condition']}": float(row["ever_solved"] or 0) for row in summary},
        (
            "A run that stops early, after a confirmation, keeps its last score in means and "
            "shares.",
            "Ever solved: the score of some generation reaches the solved reward. Handed over "
            "solved: fresh agents solve the task on the SE that the run exports. Our recipe draws "
            "these agents from the paper's full ranges. The other two recipes test the kind of "
            "agent that NES trained.",
            "Core seconds are medians over all runs and include the last confirmation. First "
            "solved: medians over the runs that solve the task. Update norm: median length of the "
            "step on the SE's parameters over the generations of all runs. Our recipe's step is "
            "on NES's coordinates of them and not comparable with the other two.",
            "Algorithm 1 divides the step by n_p sigma. Only the paper's text has this division; "
            "the authors tuned the step size for the undivided rule. The recipe compares scores "
            "with the score of agents trained on the unperturbed SE.",
        ),
    )


def _summary(name: str, curves: pd.DataFrame, ends: pd.DataFrame, solved_reward: float) -> Row:
    last = scores_by_run(curves)[:, -1]
    first = first_solved(curves, solved_reward)
    return {
        "condition": name,
        "runs": len(ends),
        "generations": float(curves.groupby("seed").size().median()),
        "core_seconds": float(ends["core_seconds"].median()),
        "score_at_end": float(last.mean()),
        "score_at_end_std": float(last.std()),
        "ever_solved": len(first) / len(ends),
        "solved_at_end": float(np.mean(last >= solved_reward)),
        "handed_over_solved": float(np.mean(ends["final_score"] >= solved_reward)),
        "median_first_solved": float(first["generation"].median()) if len(first) else None,
        "core_seconds_first_solved": float(first["core_seconds"].median()) if len(first) else None,
        "update_norm": float(curves["update_norm"].median()),
    }


def _curves(curves: dict[str, pd.DataFrame], task: Task) -> Figure:
    figure = column(0.5 + 1.35 * len(curves))
    panels: list[Axes] = list(np.atleast_1d(figure.subplots(len(curves), 1, sharey=True)))
    for axes, (name, group) in zip(panels, curves.items(), strict=True):
        _condition(axes, name, group, task)
    panels[-1].set_xlabel("generation")
    figure.supylabel("score (mean test return)", fontsize=7.5)
    handles = [
        Line2D([], [], color="black", lw=0.5, alpha=0.45, label="a run"),
        Line2D([], [], color="black", label="mean of the runs"),
        Patch(color="black", alpha=0.18, lw=0, label="standard deviation, cut at the range"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def _condition(axes: Axes, name: str, curves: pd.DataFrame, task: Task) -> None:
    """Draw all runs of a condition, with their mean and standard deviation."""
    look, scores = LOOKS[name], scores_by_run(curves)
    for _, run in curves.groupby("seed"):
        axes.plot(run["score"].to_numpy(), color=look.colour, lw=0.5, alpha=0.45)
    mean, spread = scores.mean(axis=0), scores.std(axis=0)
    lowest, highest = float(scores.min()), float(scores.max())
    band = (np.clip(edge, lowest, highest) for edge in (mean - spread, mean + spread))
    axes.fill_between(np.arange(len(mean)), *band, color=look.colour, alpha=0.18, lw=0)
    axes.plot(np.arange(len(mean)), mean, color="black")
    solved_line(axes, task.solved_reward)
    axes.set_title(f"{title_of(name)} ({count(len(scores), 'run')})")
    axes.set_xlim(0, max(len(mean) - 1, 1))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    low, high = min(task.worst_score, lowest), max(task.solved_reward, highest)
    axes.set_ylim(low, high + 0.05 * (high - low))


def _shares(curves: dict[str, pd.DataFrame], task: Task) -> Figure:
    figure = column(3.3)
    by_generation, by_time = figure.subplots(2, 1, sharey=True)
    longest = max(1, *(group["generation"].max() for group in curves.values()))
    last = max(group["core_seconds"].max() for group in curves.values())
    for name, group in curves.items():
        first, runs = first_solved(group, task.solved_reward), group["seed"].nunique()
        for axes, values, start, end in (
            (by_generation, first["generation"], 0, longest),
            (by_time, first["core_seconds"], group["core_seconds"].min(), last),
        ):
            axes.step(
                [start, *sorted(values), end],
                [*np.arange(len(first) + 1) / runs, len(first) / runs],
                where="post",
                **LOOKS[name].curve,
                markevery=slice(1, len(first) + 1),
                label=f"{title_of(name)} (n = {runs})",
            )
    by_generation.set_xlabel("generation")
    by_time.set_xlabel("core time (s)")
    by_time.set_xscale("log")
    by_time.xaxis.set_minor_formatter(NullFormatter())
    by_generation.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    for axes in (by_generation, by_time):
        axes.set_ylabel("share of runs")
        axes.set_ylim(-0.03, 1.05)
    by_generation.set_title("runs that have solved the task so far")
    legend_below(by_generation)
    return figure


SUCCESS = Experiment(
    "success",
    "Success of NES",
    "The score of the unperturbed SE over the generations of NES runs from different seeds. Thin "
    "lines are runs, and the dotted line is the return that solves the task.",
    lambda size: {"default": size.runs, "authors": size.authors_runs, "paper": size.authors_runs},
    _findings,
)

"""`success`: scores over the generations of many NES runs (paper, Figure "success")."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bilevel.tasks import Task
from cluster.evaluate.report import Row
from cluster.experiments.conditions import title_of
from cluster.experiments.experiment import Experiment, Findings, Material, Plan
from cluster.experiments.style import COLOURS, column, line_chart, solved_line
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
    scores = {name: scores_by_run(group) for name, group in curves.items()}
    return Findings(
        data,
        summary,
        {"curves": _curves(scores, task), "share": _shares(scores, task)},
        {f"share_solved/{row['condition']}": float(row["ever_solved"] or 0) for row in summary},
        (
            "A run that stops early keeps its last score in means and shares. Best SE solves: "
            "fresh agents solve the task on the SE that the run exports.",
            "Core seconds are medians over all runs and include the last confirmation. First "
            "solved: medians over the runs that solve the task. Update norm: median length of the "
            "step on the SE's parameters. Our recipe's step is on other coordinates and not "
            "comparable.",
        ),
    )


def _summary(name: str, curves: pd.DataFrame, ends: pd.DataFrame, solved_reward: float) -> Row:
    last = scores_by_run(curves)[:, -1]
    first = curves[curves["score"] >= solved_reward].groupby("seed").first()
    return {
        "condition": name,
        "runs": len(ends),
        "generations": float(curves.groupby("seed").size().median()),
        "core_seconds": float(ends["core_seconds"].median()),
        "score_at_end": float(last.mean()),
        "score_at_end_std": float(last.std()),
        "ever_solved": len(first) / len(ends),
        "solved_at_end": float(np.mean(last >= solved_reward)),
        "best_se_solves": float(np.mean(ends["final_score"] >= solved_reward)),
        "median_first_solved": float(first["generation"].median()) if len(first) else None,
        "core_seconds_first_solved": float(first["core_seconds"].median()) if len(first) else None,
        "update_norm": float(curves["update_norm"].median()),
    }


def _curves(scores: Mapping[str, Floats], task: Task) -> Figure:
    """Draw all runs and their mean in a panel per condition."""
    figure = column(0.5 + 1.35 * len(scores))
    panels = figure.subplots(len(scores), 1, sharey=True, squeeze=False)
    for axes, (name, runs) in zip(panels.flat, scores.items(), strict=True):
        axes.plot(runs.T, color=COLOURS[name], lw=0.5, alpha=0.45)
        axes.plot(runs.mean(axis=0), color="black")
        solved_line(axes, task.solved_reward)
        axes.set_title(f"{title_of(name)} (n = {len(runs)})")
    axes.set_xlabel("generation")
    figure.supylabel("score (mean test return)")
    return figure


def _shares(scores: Mapping[str, Floats], task: Task) -> Figure:
    """Draw the share of runs that have solved the task so far by generation."""
    shares = {
        name: np.maximum.accumulate(runs >= task.solved_reward, axis=1).mean(axis=0)
        for name, runs in scores.items()
    }
    return line_chart(
        {name: (np.arange(len(share)), share) for name, share in shares.items()},
        xlabel="generation",
        ylabel="share of runs that have solved the task",
    )


SUCCESS = Experiment(
    "success",
    "Success of NES",
    "The score of the unperturbed SE over the generations of NES runs from different seeds. Thin "
    "lines are runs, thick lines their mean, and the dotted line the return that solves the task.",
    lambda size: {"default": size.runs, "authors": size.authors_runs, "paper": size.authors_runs},
    _findings,
)

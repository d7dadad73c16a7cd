"""`success`: how scores rise over the generations of many NES runs (paper, Figure "success")."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, NullFormatter
from numpy.typing import NDArray

from bilevel.nes import GenerationRecord
from bilevel.tasks import Task
from cluster.experiments.authors import AUTHORS_GENERATIONS, authors_figure
from cluster.experiments.conditions import title_of
from cluster.experiments.experiment import Experiment, Findings, Material, Plan, SERun
from cluster.experiments.sizes import Size
from cluster.experiments.style import LOOKS, column, solved_line
from cluster.experiments.table import Row
from cluster.session.terminal import count

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LearningCurve:
    """The curve of one run."""

    condition: str
    seed: int
    scores: Floats  # (G,) of the unperturbed SE, by generation
    core_seconds: Floats  # (G,) spent until the end of the generation
    update_norm: Floats  # (G,) of the step on the mean
    total_core_seconds: float  # with the last confirmation
    final_score: float  # of fresh agents on the best SE

    @classmethod
    def of(cls, made: SERun) -> "LearningCurve":
        """The curve of a run that has ended."""
        state = made.state
        records: Sequence[GenerationRecord] = state.records
        return cls(
            made.condition,
            made.run.seed,
            np.array([record.score_mean for record in records]),
            np.array([record.cost for record in records]),
            np.array([record.update_norm for record in records]),
            state.cost,
            made.final["final_score_mean"],
        )

    def first_solved(self, solved_reward: float) -> int | None:
        """The first generation that solves the task; None if none does."""
        solved = np.flatnonzero(self.scores >= solved_reward)
        return int(solved[0]) if solved.size else None


def carried_forward(curves: Sequence[LearningCurve]) -> Floats:
    """Scores (runs, G) of runs of different lengths: a run keeps its last score after its end."""
    longest = max(curve.scores.size for curve in curves)
    return np.stack(
        [np.pad(one.scores, (0, longest - one.scores.size), mode="edge") for one in curves]
    )


def _runs(size: Size) -> dict[str, int]:
    return {"default": size.runs, "authors": size.authors_runs, "paper": size.authors_runs}


def _findings(plan: Plan, material: Material) -> Findings:
    curves = [LearningCurve.of(made) for made in material.ses]
    return findings_of(curves, plan.task)


def findings_of(curves: Sequence[LearningCurve], task: Task) -> Findings:
    """Table and pictures of these runs."""
    groups: dict[str, list[LearningCurve]] = {}
    for curve in curves:
        groups.setdefault(curve.condition, []).append(curve)
    data: list[Row] = [
        {
            "condition": curve.condition,
            "seed": curve.seed,
            "generation": generation,
            "score": float(score),
            "core_seconds": float(seconds),
            "update_norm": float(norm),
        }
        for curve in curves
        for generation, (score, seconds, norm) in enumerate(
            zip(curve.scores, curve.core_seconds, curve.update_norm, strict=True)
        )
    ]
    return Findings(
        data,
        [_summary(name, group, task.solved_reward) for name, group in groups.items()],
        {"curves": _curves(groups, task), "share": _shares(groups, task)},
        {
            f"share_solved/{name}": float(
                np.mean([one.first_solved(task.solved_reward) is not None for one in group])
            )
            for name, group in groups.items()
        },
        (
            "A run that has ended early, confirmed, keeps its last score in means and shares.",
            "Ever solved: the score of some generation reached the solved reward. Handed over: "
            "fresh agents solve the task on the SE that the run hands over. For our recipe these "
            "are drawn from the paper's full ranges, for the authors' rule and Algorithm 1 they "
            "are the one kind that NES trained.",
            "Core seconds are medians over all runs, with the last confirmation; first solved: "
            "medians over the runs that solve the task. Update norm: length of a generation's "
            "step on the parameters of the SE, its median over the generations of all runs (of "
            "our recipe: on NES's coordinates of them, not comparable with the other two).",
        ),
    )


def _summary(condition: str, group: Sequence[LearningCurve], solved_reward: float) -> Row:
    ends = carried_forward(group)[:, -1]
    first = [one.first_solved(solved_reward) for one in group]
    reached = [generation for generation in first if generation is not None]
    seconds = [one.core_seconds[g] for one, g in zip(group, first, strict=True) if g is not None]
    return {
        "condition": condition,
        "runs": len(group),
        "generations": float(np.median([one.scores.size for one in group])),
        "core_seconds": float(np.median([one.total_core_seconds for one in group])),
        "score_at_end": float(ends.mean()),
        "score_at_end_std": float(ends.std()),
        "ever_solved": len(reached) / len(group),
        "solved_at_end": float(np.mean(ends >= solved_reward)),
        "handed_over_solved": float(np.mean([one.final_score >= solved_reward for one in group])),
        "median_first_solved": float(np.median(reached)) if reached else None,
        "core_seconds_first_solved": float(np.median(seconds)) if reached else None,
        "update_norm": float(np.median(np.concatenate([one.update_norm for one in group]))),
    }


def _curves(groups: dict[str, list[LearningCurve]], task: Task) -> Figure:
    figure = column(0.5 + 1.35 * len(groups))
    panels: list[Axes] = list(np.atleast_1d(figure.subplots(len(groups), 1, sharey=True)))
    starred = False
    for axes, (name, group) in zip(panels, groups.items(), strict=True):
        look, scores = LOOKS[name], carried_forward(group)
        generations = np.arange(scores.shape[1])
        for curve in group:
            axes.plot(curve.scores, color=look.colour, lw=0.5, alpha=0.45)
        mean, spread = scores.mean(axis=0), scores.std(axis=0)
        ends = scores.min(), scores.max()
        band = np.clip(mean - spread, *ends), np.clip(mean + spread, *ends)
        axes.fill_between(generations, *band, color=look.colour, alpha=0.18, lw=0)
        axes.plot(generations, mean, color="black")
        theirs = _authors_end(task, name, scores)
        if theirs is not None:
            axes.plot(generations[-1:], [theirs], color="black", marker="*", ms=7, clip_on=False)
            starred = True
        solved_line(axes, task.solved_reward)
        axes.set_title(f"{title_of(name)} ({count(len(group), 'run')})")
        axes.set_xlim(0, max(len(mean) - 1, 1))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        low = min(task.worst_score, *(float(curve.scores.min()) for curve in group))
        high = max(task.solved_reward, *(float(curve.scores.max()) for curve in group))
        axes.set_ylim(low, high + 0.05 * (high - low))
    panels[-1].set_xlabel("generation")
    figure.supylabel("score (mean test return)", fontsize=7.5)
    drawn = [
        Line2D([], [], color="black", lw=0.5, alpha=0.45, label="a run"),
        Line2D([], [], color="black", label="mean of the runs"),
        Patch(color="black", alpha=0.18, lw=0, label="standard deviation, cut at the range"),
    ]
    if starred:
        drawn.append(
            Line2D([], [], color="black", marker="*", ms=7, ls="none", label="authors' mean, end")
        )
    figure.legend(handles=drawn, loc="outside lower center", ncols=2)
    return figure


def _authors_end(task: Task, condition: str, scores: Floats) -> float | None:
    """Where the authors' mean curve of that condition ends, if our scores (runs, G) go on for as
    many generations."""
    if scores.shape[1] != AUTHORS_GENERATIONS:
        return None
    figure = authors_figure(task.id, "success", {"condition": condition}, "score_at_end")
    return None if figure is None else figure.value


def _shares(groups: dict[str, list[LearningCurve]], task: Task) -> Figure:
    figure = column(3.3)
    by_generation, by_time = figure.subplots(2, 1, sharey=True)
    curves = [one for group in groups.values() for one in group]
    longest = float(max(1, *(one.scores.size - 1 for one in curves)))
    last = max(float(one.core_seconds[-1]) for one in curves)
    for name, group in groups.items():
        look = LOOKS[name]
        first = [one.first_solved(task.solved_reward) for one in group]
        generations = [float(g) for g in first if g is not None]
        seconds = [
            float(one.core_seconds[g]) for one, g in zip(group, first, strict=True) if g is not None
        ]
        begin = min(float(one.core_seconds[0]) for one in group)
        for axes, events, start, end in (
            (by_generation, generations, 0.0, longest),
            (by_time, seconds, begin, last),
        ):
            x = [start, *sorted(events), end]
            y = [*np.arange(len(events) + 1) / len(group), len(events) / len(group)]
            axes.step(
                x,
                y,
                where="post",
                color=look.colour,
                ls=look.line,
                marker=look.marker,
                markevery=slice(1, len(events) + 1),
                label=f"{title_of(name)} (n = {len(group)})",
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
    figure.legend(*by_generation.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


SUCCESS = Experiment(
    "success",
    "Success of NES",
    "The score of the unperturbed SE, psi, over the generations of NES runs from different seeds. "
    "Thin lines are runs; the dotted line is the return that solves the task.",
    _runs,
    _findings,
    interim=True,
)

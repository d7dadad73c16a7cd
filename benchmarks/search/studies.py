"""Long searches for better defaults: what they found, beside the recipe `default`.

    python -m benchmarks.search.studies

The studies lie in `studies`, a home without checkpoints and MLflow's database; `bilevel sync NAME
--home benchmarks/search/studies` shows one in MLflow. `found-TASK.toml` are their incumbents, and
`unvalidated-TASK.toml` their best results before the validation, where that chose otherwise;
`benchmarks.nes.seeds` runs these and the defaults over seeds that no choice was made on. This
program draws the pictures of docs/tuning.md.
"""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import fisher_exact, mannwhitneyu

from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import source, table
from bilevel.tasks import get_task
from cluster.bohb.journal import Journal
from cluster.bohb.pictures import objective_against_cost
from cluster.bohb.study import Study, configuration_name
from cluster.bohb.summary import StudySummary

STUDIES = Path(__file__).parent / "studies"
PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
TASKS = ("CartPole-v0", "Acrobot-v1")
#: Recipes that a search led to, and the endings of their results over seeds.
RECIPES = {"best of the search": "_unvalidated", "incumbent": "_found"}


def committed(task: str) -> Study:
    """The study on a task. Raises NotMeasured without one."""
    for settings in sorted(STUDIES.glob(f"{task}/*/settings.json")):
        return Study.read(settings.parent)
    raise NotMeasured(f"a study in `benchmarks/search/studies/{task}`")


def summary(study: Study) -> StudySummary:
    """What the journal of a study tells."""
    journal = Journal(study.folder)
    brackets = 1 + max(line.id[0] for line in journal.configs)
    return StudySummary.of(journal, study.schedule.brackets(brackets))


def searches() -> str:
    """What each search tried, and what the objectives of its finalists rest on."""
    rows = []
    for task in TASKS:
        try:
            study = committed(task)
        except NotMeasured:
            continue
        told = summary(study)
        rows.append(
            (
                task,
                str(len(told.journal.configs)),
                str(told.model_based),
                f"{told.points()[-1].spent / 3600:.1f}",
                f"{sum(line.budget for line in told.finalists) / 3600:.1f}",
                f"`{study.name}`",
            )
        )
    if not rows:
        raise NotMeasured("studies in `benchmarks/search/studies`")
    head = ["task", "configurations", "of the model", "core hours", "of validation", "study"]
    return table(head, rows)


def validations() -> str:
    """What became of the finalists over new seeds."""
    rows = []
    for task in TASKS:
        try:
            told = summary(committed(task))
        except NotMeasured:
            continue
        proposals = {line.id: line for line in told.journal.configs}
        for line in told.finalists:
            before, proposal = told.result_of(line.id), proposals[line.id]
            rows.append(
                (
                    task,
                    "the recipe" if proposal.of_prior else configuration_name(line.id),
                    *(
                        f"{one.info['confirmed']} in {one.info['core_seconds']:.0f}"
                        for one in (before, line)
                    ),
                    f"{before.loss:.0f}",
                    f"{line.loss:.0f}",
                )
            )
    if not rows:
        raise NotMeasured("studies in `benchmarks/search/studies`")
    head = [
        "task",
        "configuration",
        "SEs in core seconds, search",
        "new seeds",
        "objective, search",
        "new seeds",
    ]
    return table(head, rows)


def found() -> str:
    """The recipes before the search and those that it led to, over fresh seeds."""
    rows, results = [], []
    for task in TASKS:
        led_to: dict[str, Any] = {}
        for title, ending in RECIPES.items():
            with suppress(NotMeasured):
                led_to[title] = read_result(f"nes_seeds_{task}{ending}", "runs")
        if not led_to:
            continue
        before = read_result(f"nes_seeds_{task}", "runs")
        results += [before, *led_to.values()]
        rows.append((task, "default", *_quality(before["runs"]), "", ""))
        for title, result in led_to.items():
            costs = [[run["core_seconds"] for run in of["runs"]] for of in (before, result)]
            solved = [sum(run["solved"] for run in of["runs"]) for of in (before, result)]
            missed = [len(of["runs"]) - n for of, n in zip((before, result), solved, strict=True)]
            p = [mannwhitneyu(*costs).pvalue, fisher_exact([solved, missed]).pvalue]
            rows.append((task, title, *_quality(result["runs"]), *(f"{one:.1g}" for one in p)))
    if not results:
        raise NotMeasured("`benchmarks/results/nes_seeds_*_found.json`")
    head = [
        "task",
        "recipe",
        "solved",
        "confirmed",
        "of these solved",
        "core seconds, median and range",
        "core seconds an SE",
        "train steps of an agent",
        "p of core seconds",
        "p of solved",
    ]
    return f"{table(head, rows)}\n\n{source(*results)}"


def _quality(runs: list[dict[str, Any]]) -> tuple[str, ...]:
    costs = [run["core_seconds"] for run in runs]
    confirmed = sum(run["confirmed"] for run in runs)
    return (
        f"{sum(run['solved'] for run in runs)} of {len(runs)}",
        f"{confirmed} of {len(runs)}",
        f"{sum(run['solved'] and run['confirmed'] for run in runs)} of {confirmed}",
        f"{np.median(costs):.0f} ({min(costs):.0f} to {max(costs):.0f})",
        f"{sum(costs) / confirmed:.0f}",
        f"{np.median([run['final_train_steps'] for run in runs]):.0f}",
    )


def main() -> None:
    """Draw the pictures of the committed studies."""
    for task in TASKS:
        try:
            study = committed(task)
        except NotMeasured as missing:
            print(f"not drawn: {missing}")
            continue
        told = summary(study)
        points, validated = told.points(), told.validated_points()
        figure = objective_against_cost(points, validated, get_task(task), study.method_name)
        path = PICTURES / f"search-{task}.svg"
        figure.savefig(path, metadata={"Date": None})
        print(f"drawn: {path}")


if __name__ == "__main__":
    main()

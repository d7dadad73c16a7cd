"""Compare BOHB, Hyperband and random search at equal core time, by the recipes that they find.

    python -m benchmarks.search.compare CartPole-v0 --seeds 0-5 --home FOLDER

Each search is the study of `bilevel bohb TASK --method METHOD --seed SEED --space SPACE --prior
none` with the budgets below, in one process with one trial at a time, so that its proposals do not
depend on the timing of trials. Its recipe and the recipe `default` then run NES with fresh seeds,
the same for all recipes. As many searches or runs as cores are processed at a time. Results are
written one by one to `results/search_TASK.json`; the same command resumes.
"""

import argparse
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.machine import (
    earlier_result,
    format_seeds,
    known_task,
    parse_seeds,
    write_result,
)
from benchmarks.nes.run import run_nes
from bilevel.errors import OtherVersion, StorageFailure
from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource, evaluate
from bilevel.hyperparameters import Hyperparameters
from bilevel.recipes import load_recipe
from bilevel.tasks import Task, get_task
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import validate
from cluster.bohb.study.brackets import Schedule, core_seconds_to_run
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import Journal, Origin
from cluster.bohb.study.profiles import METHODS, PROFILES, searched_space, sized
from cluster.nes.run import Pool
from cluster.storage.run_folder import locked_settings
from search_spaces.space import Space
from search_spaces.translation import to_hyperparameters

#: The space `core` without the SE's step limit and spread, which a search exploits
#: (docs/tuning.md). BOHB's model needs fewer results for six hyperparameters than for eight.
SPACE = Path(__file__).with_name("core-without-episodes.json")

#: Core seconds of the lowest and the highest rung: half of the smallest budget of the profile
#: `local`, so that BOHB's model has results to propose from after less than half of the time.
BUDGETS = 15, 45

#: Seed of the first fresh run.
FRESH_SEED = 10_000


def brackets_of(method: str, core_seconds: int) -> tuple[int, Schedule]:
    """Return the number of brackets that cost about this much, and the schedule."""
    schedule = Schedule.of(method, *BUDGETS, PROFILES["local"].cycle)
    return max(round(core_seconds / core_seconds_to_run(schedule.brackets(1))), 1), schedule


def base_of(task: Task) -> Hyperparameters:
    """Return the hyperparameters that are not searched."""
    return sized(load_recipe("exogenous", task), PROFILES["local"])


class InProcess:
    """A pool that evaluates in this process."""

    size = 1

    def run(
        self,
        task: Task,
        se: SESource,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> list[EvaluationResult]:
        """Evaluate one request after the other."""
        results = []
        for request in requests:
            results.append(evaluate(task, se, request))
            on_result(results[-1])
        return results


def run_in_process(
    study: Study, brackets: int, pool: Pool, log: Callable[[str], None]
) -> StudySummary:
    """Run or resume a study and its validation in this process, one job after the other."""
    journal = Journal(study.folder)
    rungs = study.schedule.brackets(brackets)
    bracket_search = BracketSearch(study, journal, brackets)
    while (job := bracket_search.next_job()) is not None:
        try:
            runs = ConfigurationRuns(study, job.id, job.configuration, log=log).read()
            runs.spend(job.budget, pool)
        except (StorageFailure, OtherVersion):
            raise
        except Exception as error:  # a failed trial
            bracket_search.register(job, None, exception=str(error))
            continue
        bracket_search.register(job, runs.tally.objective, runs.tally.info)
        left = StudySummary.of(journal, rungs).core_seconds_left()
        log(f"{study.name}: objective {runs.tally.objective:.1f}, {left} core s left")
    validate(study, journal, pool, log)
    return StudySummary.of(journal, rungs)


def outcomes(journal: Journal) -> dict[str, dict[str, list[tuple[float, int]]]]:
    """Return objectives and numbers of confirmed SEs by budget and origin of configurations.

    The objective of a failure is infinite. Results of the recipe itself do not count.
    """
    origins = (Origin.RANDOM, Origin.AROUND_RECIPE, Origin.MODEL)
    budgets = sorted({line.budget for line in journal.results})
    found: dict[str, dict[str, list[tuple[float, int]]]] = {
        str(budget): {origin.value: [] for origin in origins} for budget in budgets
    }
    for line in journal.results:
        origin = journal.proposals[line.id].origin
        if origin is not Origin.RECIPE:
            objective = math.inf if line.loss is None else line.loss
            outcome = objective, line.info.get("confirmed", 0)
            found[str(line.budget)][origin.value].append(outcome)
    return found


def search(task_id: str, method: str, seed: int, core_seconds: int, home: Path) -> dict[str, Any]:
    """Run a search; return its cost, outcomes and incumbent."""
    brackets, schedule = brackets_of(method, core_seconds)
    task = get_task(task_id)
    base = base_of(task)
    space = searched_space(Space.of(str(SPACE)), task, base)
    folder = home / task_id / f"{method}-seed{seed}"
    study = Study(folder, task, seed, space, schedule, base, method)
    with locked_settings(folder, study.settings()):
        summary = run_in_process(study, brackets, InProcess(), partial(print, flush=True))
    incumbent = summary.incumbent
    assert incumbent is not None
    return {
        "core_seconds": core_seconds_to_run(summary.rungs),
        "validation_core_seconds": sum(line.budget for line in summary.finalists),
        "results": len(summary.journal.results),
        "outcomes": outcomes(summary.journal),
        "incumbent": incumbent.loss,
        "configuration": summary.journal.proposals[incumbent.id].configuration,
    }


def fresh_run(task_id: str, configuration: dict[str, Any], seed: int) -> dict[str, Any]:
    """Run NES with a configuration ({}: the recipe `default`) and a fresh seed."""
    task = get_task(task_id)
    return run_nes(task, to_hyperparameters(base_of(task), configuration), seed)


class Comparison:
    """The measurements of a task. `rows` has one entry for `default` and one per search."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.name = f"search_{options.task}"
        before = earlier_result(self.name, self.command, ("seeds", "fresh")).get("rows", {})
        self.rows: dict[str, Any] = {"default": {}, **before}
        measured = {row["seed"] for row in before.values() if "seed" in row}
        options.seeds = sorted({*options.seeds, *measured})
        options.fresh = max(
            [options.fresh, *(len(row.get("fresh", ())) for row in before.values())]
        )
        for seed in options.seeds:
            for method in METHODS:
                self.rows.setdefault(f"{method} {seed}", {"method": method, "seed": seed})

    @property
    def command(self) -> str:
        """The command that measures all of it."""
        options = self.options
        return (
            f"python -m benchmarks.search.compare {options.task} --seeds "
            f"{format_seeds(options.seeds)} --core-seconds {options.core_seconds} --fresh "
            f"{options.fresh} --home FOLDER"
        )

    def missing_searches(self) -> list[str]:
        """Return the keys of searches that have not ended."""
        return [key for key, row in self.rows.items() if "method" in row and "search" not in row]

    def missing_fresh_runs(self) -> list[tuple[str, int]]:
        """Return keys and seeds of the missing fresh runs of finished searches."""
        seeds = range(FRESH_SEED, FRESH_SEED + self.options.fresh)
        return [
            (key, seed)
            for key, row in self.rows.items()
            if key == "default" or "search" in row
            for seed in seeds
            if seed not in {run["seed"] for run in row.get("fresh", ())}
        ]

    def configuration(self, key: str) -> dict[str, Any]:
        """Return the configuration that a search found; {} for `default`."""
        found: dict[str, Any] = self.rows[key].get("search", {}).get("configuration", {})
        return found

    def run(self) -> None:
        """Measure the missing searches, then the missing fresh runs."""
        options = self.options
        with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
            searches = {}
            for key in self.missing_searches():
                row = self.rows[key]
                arguments = row["method"], row["seed"], options.core_seconds, options.home
                searches[pool.submit(search, options.task, *arguments)] = key
            for job in as_completed(searches):
                self.add_search(searches[job], job.result())
            runs = {
                pool.submit(fresh_run, options.task, self.configuration(key), seed): key
                for key, seed in self.missing_fresh_runs()
            }
            for job in as_completed(runs):
                self.add_fresh_run(runs[job], job.result())

    def add_search(self, key: str, found: dict[str, Any]) -> None:
        """Store the result of a search."""
        self.rows[key]["search"] = found
        self._write(key, found)

    def add_fresh_run(self, key: str, run: dict[str, Any]) -> None:
        """Store a fresh run."""
        row = self.rows[key]
        row["fresh"] = sorted([*row.get("fresh", ()), run], key=lambda run: int(run["seed"]))
        self._write(key, run)

    def _write(self, key: str, found: dict[str, Any]) -> None:
        begun = {name: row for name, row in self.rows.items() if {"search", "fresh"} & row.keys()}
        write_result(self.name, self.command, {"rows": begun}, resumed=True)
        print(key, found, flush=True)


def main() -> None:
    """Measure the missing results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", type=known_task)
    parser.add_argument("--seeds", type=parse_seeds, required=True, help="such as 0-5")
    parser.add_argument(
        "--core-seconds", type=int, default=900, help="per search, without validation"
    )
    parser.add_argument("--fresh", type=int, default=10, help="NES runs per recipe")
    parser.add_argument("--home", type=Path, required=True)
    Comparison(parser.parse_args()).run()


if __name__ == "__main__":
    main()

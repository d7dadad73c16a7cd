"""BOHB, Hyperband and random search at equal core time, by the recipes that they find.

    python -m benchmarks.search.compare CartPole-v0 --seeds 0-5 --home FOLDER

Each search is the study of `bilevel bohb TASK --method METHOD --seed SEED --space SPACE --prior
none`, but with the budgets below, of so many core seconds and a third as many for its validation,
with one trial at a time. It runs in one process, so that what it proposes does not depend on how
trials happen to be timed, and there are as many searches at a time as cores. Its recipe then runs
NES with fresh seeds, the same for all recipes, until an SE is confirmed or the generations are
over; ten fresh agents of the paper's full ranges score the SE. The recipe `default` is measured
alike. Results are written one by one to `results/search_TASK.json`; the same command resumes.

Searches with equal seeds share random configurations and the seeds of their NES runs. An evaluation
is a pure function of its request, so those that an earlier search has made with the same code are
read from FOLDER, but count in full.
"""

import argparse
import os
import pickle
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from itertools import product
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

import joblib

import bilevel
from benchmarks.arguments import format_seeds, known_task, parse_seeds
from benchmarks.machine import require_as_many, require_seeds, resumed_result, write_result
from benchmarks.nes.run import run_nes
from benchmarks.search.outcomes import outcomes
from bilevel.durable import checksum, write_aside
from bilevel.errors import OtherVersion, StorageFailure
from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource, evaluate
from bilevel.hyperparameters import Hyperparameters, load_recipe
from bilevel.tasks import Task, get_task
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.bracket_search import BracketSearch
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import Plan, validate
from cluster.bohb.study.brackets import Schedule, core_seconds_to_run
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import Journal
from cluster.bohb.study.profiles import METHODS, get_profile, sized
from cluster.bohb.study.rules import searched_space
from cluster.nes.run import Pool
from cluster.storage.run_folder import locked_settings
from search_spaces.space import Space
from search_spaces.translation import to_hyperparameters

#: The space `core` without the SE's step limit and spread. (docs/tuning.md tells what a search of
#: the episodes' length exploits; and BOHB's model needs fewer results for six hyperparameters than
#: for eight.)
SPACE = Path(__file__).with_name("core-without-episodes.json")

#: Core seconds of the lowest and the highest rung. With those of `local`, half an hour suffices for
#: 27 configurations, and BOHB's model has no results to propose from before the last dozen. With
#: half of the smallest budget, and without the largest, whose part the validation has, 36 take less
#: than half of that time.
BUDGETS = 15, 45

#: Rooms of the package on which the result of an evaluation does not depend.
_APART = {"compile.py", "distilled", "gym", "interop", "nes", "zoo"}

#: Seed of the first fresh run.
_FRESH = 10_000


def brackets_of(method: str, core_seconds: int) -> tuple[int, Schedule]:
    """Number of brackets that cost so much, and the schedule."""
    schedule = Schedule.of(method, *BUDGETS, get_profile("local").cycle)
    return max(round(core_seconds / core_seconds_to_run(schedule.brackets(1))), 1), schedule


def base_of(task: Task) -> Hyperparameters:
    """What a configuration leaves unsaid."""
    return sized(load_recipe("default", task), get_profile("local"))


class InProcess:
    """A pool of this process alone, which keeps what it has evaluated in a folder."""

    size = 1

    def __init__(self, kept: Path) -> None:
        self._kept = kept

    def run(
        self,
        task: Task,
        se: SESource,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> list[EvaluationResult]:
        """Evaluate one request after the other, or read what came of these requests before."""
        path = self._kept / f"{joblib.hash((task.id, se, requests))}.pickle"
        if path.exists():
            results: list[EvaluationResult] = pickle.loads(path.read_bytes())
        else:
            results = [evaluate(task, se, request) for request in requests]
            write_aside(path, pickle.dumps(results))
        for result in results:
            on_result(result)
        return results


def kept_evaluations(home: Path, task_id: str) -> InProcess:
    """The pool of all searches and fresh runs of a task."""
    package = Path(bilevel.__file__).parent
    sources = [
        path.read_bytes()
        for path in sorted(package.rglob("*.py"))
        if path.relative_to(package).parts[0] not in _APART
    ]
    code = checksum(*sources)[:16]
    return InProcess(home / task_id / f"evaluations-{code}")


def run_in_process(
    study: Study, brackets: int, pool: Pool, log: Callable[[str], None]
) -> StudySummary:
    """Run or resume a study and its validation in this process, one job after the other; return
    what it found."""
    journal = Journal(study.folder)
    rungs = study.schedule.brackets(brackets)
    search = BracketSearch.of(study, journal, brackets)
    while (job := search.next_job()) is not None:
        try:
            runs = ConfigurationRuns.open(study, job.id, job.configuration, log)
            runs.spend(job.budget, pool)
        except (StorageFailure, OtherVersion):
            raise
        except Exception as error:  # as in a trial
            search.register(job, None, exception=str(error))
            continue
        search.register(job, runs.tally.objective, runs.tally.info)
        left = StudySummary.of(journal, rungs).core_seconds_left()
        log(f"{study.name}: objective {runs.tally.objective:.1f}, {left} core s left")
    plan = Plan.of(journal, None, study.schedule.budgets[-1])
    if plan is not None:
        validate(study, journal, plan, pool, log, lambda spent, total: None, lambda: False)
    return StudySummary.of(journal, rungs)


def search(task_id: str, method: str, seed: int, core_seconds: int, home: Path) -> dict[str, Any]:
    """Run a search; return what it found."""
    brackets, schedule = brackets_of(method, core_seconds)
    task = get_task(task_id)
    base = base_of(task)
    space = searched_space(Space.of(str(SPACE)), task, base)
    folder = home / task_id / f"{method}-seed{seed}"
    study = Study(folder, task, seed, space, schedule, base, method)
    with locked_settings(folder, study.settings()):
        pool = kept_evaluations(home, task_id)
        summary = run_in_process(study, brackets, pool, partial(print, flush=True))
    incumbent = summary.incumbent
    assert incumbent is not None
    return {
        "core_seconds": core_seconds_to_run(summary.rungs),
        "validation_core_seconds": sum(line.budget for line in summary.finalists),
        "results": len(summary.journal.results),
        "outcomes": outcomes(summary.journal),
        "incumbent": incumbent.loss,
        "configuration": summary.configuration(incumbent.id),
    }


def fresh_run(
    task_id: str, configuration: dict[str, Any], number: int, home: Path
) -> dict[str, Any]:
    """Run NES by a configuration (empty: by the recipe `default`) with a fresh seed."""
    task, pool = get_task(task_id), kept_evaluations(home, task_id)
    hp = to_hyperparameters(base_of(task), configuration)
    return run_nes(task, hp, _FRESH + number, partial(pool.run, task))


def end_with_parent() -> None:
    """End this process as soon as its parent has ended: it would go on with its search, beside the
    process that resumes it."""
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@dataclass(frozen=True)
class Measurement:
    """A search, or a fresh run of what it found."""

    row: str
    number: int | None  # of the fresh run; None: the search
    measure: Callable[..., dict[str, Any]]
    arguments: tuple[Any, ...]


class Comparison:
    """The measurements of a task, made by processes and kept in rows as they end."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.name = f"search_{options.task}"
        before = resumed_result(self.name, self.command, ("seeds", "fresh")).get("rows", {})
        measured = {row["seed"] for row in before.values() if "seed" in row}
        require_seeds(self.name, measured, options.seeds)
        fresh = max((len(row.get("fresh", ())) for row in before.values()), default=0)
        require_as_many(self.name, "--fresh", fresh, options.fresh)
        self.rows: dict[str, Any] = {"default": {}, **before}
        # Searches with equal seeds one after the other, those with others beside each other.
        cores = os.cpu_count() or 1
        for place in range(0, len(options.seeds), cores):
            for method, seed in product(METHODS, options.seeds[place : place + cores]):
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

    def run(self) -> None:
        """Measure what is missing, the fresh runs of a recipe before other searches."""
        cores = os.cpu_count() or 1
        left = deque(one for key in self.rows for one in self.missing(key))
        running: dict[Future[dict[str, Any]], Measurement] = {}
        spawn = get_context("spawn")
        with ProcessPoolExecutor(cores, spawn, initializer=end_with_parent) as processes:
            while left or running:
                while left and len(running) < cores:
                    one = left.popleft()
                    running[processes.submit(one.measure, *one.arguments)] = one
                done = next(as_completed(running))
                one = running.pop(done)
                self.add(one, done.result())
                if one.number is None:
                    left.extendleft(reversed(self.missing(one.row)))

    def missing(self, key: str) -> list[Measurement]:
        """What a row needs next."""
        row, options = self.rows[key], self.options
        if "search" not in row and key != "default":
            asked = options.task, row["method"], row["seed"], options.core_seconds, options.home
            return [Measurement(key, None, search, asked)]
        configuration = row["search"]["configuration"] if "search" in row else {}
        there = {run["seed"] for run in row.get("fresh", ())}
        return [
            Measurement(key, number, fresh_run, (options.task, configuration, number, options.home))
            for number in range(options.fresh)
            if _FRESH + number not in there
        ]

    def add(self, one: Measurement, found: dict[str, Any]) -> None:
        """Keep what was measured."""
        row = self.rows[one.row]
        if one.number is None:
            row["search"] = found
        else:
            row["fresh"] = sorted([*row.get("fresh", ()), found], key=lambda run: int(run["seed"]))
        begun = {name: row for name, row in self.rows.items() if {"search", "fresh"} & row.keys()}
        write_result(self.name, self.command, {"rows": begun}, resumed=True)
        print(one.row, found, flush=True)


def main() -> None:
    """Measure what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", type=known_task)
    parser.add_argument("--seeds", type=parse_seeds, required=True, help="such as 0-5")
    parser.add_argument(
        "--core-seconds", type=int, default=900, help="of a search, without validation"
    )
    parser.add_argument("--fresh", type=int, default=10, help="NES runs of each recipe")
    parser.add_argument("--home", type=Path, required=True)
    Comparison(parser.parse_args()).run()


if __name__ == "__main__":
    main()

"""MLflow views of a study: one parent run with BOHB's results, one child run per configuration."""

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bilevel.errors import InvalidInput
from bilevel.nes import NESState
from bilevel.synthetic_env import se_bytes
from cluster.bohb.results import pictures
from cluster.bohb.results.importance import importance, unit_values
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.results.tables import TALLIED, leaders_csv, results_csv
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import KIND, RECIPE_FILE, SPACE_FILE, Study, configuration_name
from cluster.bohb.study.journal import ConfigId, ConfigLine, Journal, ResultLine
from cluster.bohb.study.profiles import ENDLESS
from cluster.nes.view import (
    edition,
    registered,
    run_documents,
)
from cluster.pictures import png
from cluster.session.terminal import last_line
from cluster.storage.run_folder import BEST_FILE, Lifetime, RunIdentity, Status, finals
from cluster.tracking import Document, Point, Progress, RunView


@dataclass(frozen=True)
class StudyViews:
    """The MLflow runs of a study; `live` while a process works on it, and `running` are the names
    of the configurations that it runs."""

    study: Study
    identity: RunIdentity
    live: bool
    running: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, folder: Path) -> "StudyViews":
        """Views of a study that no process works on. Raises InvalidInput if it is damaged."""
        return cls(Study.read(folder), RunIdentity.read(folder), False)

    @property
    def task_id(self) -> str:
        """The study's task."""
        return self.study.task.id

    @property
    def parent(self) -> str:
        """Key of the study's own run."""
        return self.identity.uuid

    def key(self, name: str) -> str:
        """Key of a configuration's run."""
        return f"{self.parent}/{name}"

    def keys(self) -> list[str]:
        """All keys, the study's own first. Raises InvalidInput."""
        journal = Journal(self.study.folder)
        return [self.parent, *(self.key(configuration_name(line.id)) for line in journal.configs)]

    def view(self, key: str) -> RunView:
        """The run with that key as it is on disk. Raises InvalidInput."""
        journal = Journal(self.study.folder)
        if key == self.parent:
            return self._study(journal)
        for line in journal.configs:
            if self.key(configuration_name(line.id)) == key:
                results = [result for result in journal.results if result.id == line.id]
                return self._configuration(line, results)
        raise InvalidInput(f"study {self.study.name!r} has no run {key}")

    # -- the study's own run -----------------------------------------------------

    def _study(self, journal: Journal) -> RunView:
        study, ends = self.study, finals(self.study.folder)
        lifetime = Lifetime.of(study.folder, self.identity.began, self.live)
        summary = StudySummary.of(journal, study.schedule.brackets(lifetime.target))
        tags = {"bilevel.kind": KIND}
        incumbent = summary.incumbent
        if incumbent is not None:
            tags["bilevel.incumbent"] = configuration_name(incumbent.id)
        points = [
            Point(
                {"objective": line.objective, "budget": line.budget},
                number,
                journal.results[number - 1].finished,
            )
            for number, line in summary.leaders()
        ]
        points += _best_at_each_budget(journal.results)
        if summary.validation is not None:
            winner = summary.validation.winner
            validated = {"validated_objective": winner.objective}
            points.append(Point(validated, summary.validation.results, winner.finished))
        points += [
            Point({"core_utilisation": line.info["core_utilisation"]}, number, line.finished)
            for number, line in enumerate(journal.results, start=1)
            if "core_utilisation" in line.info
        ]
        return RunView(
            self.parent,
            study.name,
            lifetime,
            {
                "task": study.task.id,
                "seed": study.seed,
                "space": study.space.name,
                "budgets": list(study.schedule.budgets),
                "cycle": study.schedule.cycle,
                "method": study.method,
                "prior": study.prior,
                "base": study.base.to_dict(),
            },
            tags,
            (*points, *(Point.of_final(end) for end in ends)),
            tuple(self._documents(journal, summary, bool(ends), lifetime.over)),
            model=registered(study.folder, study.task.id, ends[-1]) if ends else None,
            identity=self.identity,
            description=self._description(),
        )

    def _documents(
        self, journal: Journal, summary: StudySummary, ended: bool, over: bool
    ) -> list[Document]:
        study = self.study
        documents = [Document.of_file(study.folder / BEST_FILE)] if ended else []
        incumbent = summary.incumbent
        if not journal.results:
            return documents

        def picture() -> bytes:
            points, validated = summary.points(), summary.validated_points()
            figure = pictures.objective_against_cost(points, validated, study.task, study.name)
            return png(figure)

        validated = 0 if summary.validation is None else summary.validation.results
        results = f"{len(journal.results)} results, {validated} validated"
        documents += [
            Document("objective_against_cost.png", results, picture),
            Document.of_text("brackets.md", summary.bracket_table()),
            Document.of_text("results.csv", results_csv(summary)),
            Document.of_text("leaders.csv", leaders_csv(summary)),
            *(Document.of_file(path, "journal/") for path in journal.paths),
        ]
        if (study.folder / SPACE_FILE).exists():
            documents.append(Document.of_file(study.folder / SPACE_FILE, "journal/"))
        if summary.validation is not None:
            documents.append(Document.of_text("validation.md", summary.validation_table()))
        if incumbent is not None:
            # While the study runs, at every tenth result from the tenth on: the forests take a
            # second.
            number = len(journal.results)
            if number > 10 and not over:
                number -= number % 10
            name = configuration_name(incumbent.id)
            documents.append(
                Document(
                    "hyperparameters.png",
                    f"{number} results" + (f", incumbent {name}" if summary.validation else ""),
                    lambda: png(hyperparameter_picture(study, summary)),
                )
            )
            values = summary.configuration(incumbent.id)
            documents.append(Document.of_text("incumbent.json", json.dumps(values, indent=2)))
            text = study.recipe_text(incumbent.id, values)
            documents.append(Document.of_text(RECIPE_FILE, text))
        return documents

    def _description(self) -> str:
        study = self.study
        return (
            f"{study.method_name} over NES on **{study.task.id}**, recipe "
            f"`{study.base.recipe}`, {study.start}"
            f"rule `{study.base.nes.update}`: search space `{study.space.name}`, "
            f"budgets {list(study.schedule.budgets)} core seconds (eta 3), seed {study.seed}. Each "
            "child run is one configuration, which runs NES with one seed after the other; a "
            "promoted one continues in the same run. `objective`, which is minimised, is the "
            "expected core time to an SE that fresh agents confirm: the core seconds of all runs "
            "of a configuration, divided by the number of its confirmed SEs (a run that is not "
            "over counts as half of one at most). It is that of the best configuration at the "
            "largest budget so far, and rises when a larger one is reached; `best_at_*` are those "
            "at each budget. `validated_objective` is that of the recipe that "
            "is handed over, from new runs with seeds that the search made no choice on "
            "(validation.md). "
            "`final_*` are of fresh agents trained on the best SE of all configurations."
        )

    # -- a configuration's run ---------------------------------------------------

    def _configuration(self, line: ConfigLine, results: list[ResultLine]) -> RunView:
        study, name = self.study, configuration_name(line.id)
        failure = next((r.exception for r in results if r.exception is not None), None)
        try:
            runs = ConfigurationRuns.read(study, line.id, line.configuration)
        except InvalidInput:
            if failure is None:
                raise
            runs = ConfigurationRuns(study, line.id, line.configuration)  # was never allowed to run
        running = name in self.running
        tags = {
            "bilevel.kind": "configuration",
            "bilevel.bracket": str(line.id[0]),
            "bilevel.origin": line.origin.value,
        }
        documents: list[Document] = []
        if failure is not None:
            tags["bilevel.error"] = last_line(failure)[:250]
            documents.append(Document.of_text("error.txt", failure))
        best = runs.best
        if best is not None and not running:
            version = f"generation {runs.generations}"
            document = Document(BEST_FILE, version, lambda: se_bytes(best))
            hp = runs.run(0).hp
            documents += run_documents(runs.states, hp, f"{study.name}, {name}", document)
        points = _points(runs.states)
        points += [
            Point(
                {"objective": r.loss, "budget": float(r.budget), **_tallied(r)},
                r.budget,
                r.finished,
            )
            for r in results
            if r.loss is not None
        ]
        times = [point.time for point in points] + [result.finished for result in results]
        started = self.identity.began if results else time.time()
        if runs.generations:
            first = next(state.records[0] for state in runs.states if state.records)
            started = first.finished - first.generation_seconds
        lifetime = (
            Lifetime("RUNNING", started, None)
            if running
            else Lifetime(_status(results, runs.tally.cost), started, max(times, default=started))
        )
        return RunView(
            self.key(name),
            name,
            lifetime,
            line.configuration,  # and all the rest in configuration.json
            tags,
            tuple(points),
            tuple(documents),
            parent=self.parent,
            edition=edition(runs.states),
            identity=replace(self.identity, code={}),  # which of it has run, nobody knows
            description=f"Configuration {name} of the study `{study.name}`.",
        )


def hyperparameter_picture(study: Study, summary: StudySummary) -> Figure:
    """The picture of what was tried, and what it did. Raises InvalidInput if the file of the space
    is damaged."""
    space, journal = study.stored_space(), summary.journal
    values = {line.id: unit_values(space, line.configuration) for line in journal.configs}
    width = len(space)
    return pictures.hyperparameters(
        np.array([values[one] for one in summary.ranked]).reshape(-1, width),
        np.array([values[one] for one in _way(summary)]).reshape(-1, width),
        unit_values(space, study.of_recipe),
        tuple(space),
        importance(space, journal),
        f"{study.name}, {study.task.id}",
    )


def _way(summary: StudySummary) -> list[ConfigId]:
    """The configurations that led one after the other, and the incumbent, which may be another one
    since the validation."""
    way = [line.id for _, line in summary.leaders()]
    incumbent = summary.incumbent
    return way if incumbent is None or incumbent.id == way[-1] else [*way, incumbent.id]


def _best_at_each_budget(results: Sequence[ResultLine]) -> list[Point]:
    """One point for each result that is the best so far at its budget."""
    best: dict[int, float] = {}
    points = []
    for number, line in enumerate(results, start=1):
        if line.loss is not None and line.loss < best.get(line.budget, np.inf):
            best[line.budget] = line.loss
            points.append(Point({f"best_at_{line.budget}": line.loss}, number, line.finished))
    return points


def _points(states: Sequence[NESState]) -> list[Point]:
    """One point per generation of all runs, one run after the other."""
    points: list[Point] = []
    for number, state in enumerate(states):
        before = len(points)
        points += [Point.of(record, before, run=number) for record in state.records]
    return points


def _tallied(result: ResultLine) -> dict[str, float]:
    """What an objective rests on, as metrics."""
    return {name: float(result.info[name]) for name in TALLIED if name in result.info}


def _status(results: list[ResultLine], cost: float) -> Status:
    """MLflow status of a configuration's run that no process works on, whose runs have cost so many
    core seconds."""
    if any(result.loss is None for result in results):
        return "FAILED"
    spent = max((result.info.get("core_seconds", 0.0) for result in results), default=-1.0)
    return "FINISHED" if spent >= round(cost, 2) else "KILLED"


def study_progress(folder: Path, brackets: int) -> Progress:
    """Number of results, and the incumbent's objective, of a study of so many brackets. Raises
    InvalidInput."""
    journal = Journal(folder)
    rungs = Study.schedule_in(folder).brackets(brackets)
    incumbent = StudySummary.of(journal, rungs).incumbent
    best = "" if incumbent is None else f"{incumbent.loss:.0f} core s"
    results = len(journal.results)
    if brackets >= ENDLESS:
        return Progress(f"{results} results", best)
    total = max(sum(rung.configurations for rung in rungs), results)
    return Progress(f"{results}/{total} results", best)

"""MLflow views of a study: a run with BOHB's results, and a nested run per configuration."""

import json
import time
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from bilevel.errors import InvalidInput
from bilevel.synthetic_env import se_bytes
from cluster.bohb.results import pictures
from cluster.bohb.results.importance import importance, unit_values
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.results.tables import TALLIED, brackets_csv, results_csv, validation_csv
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import (
    KIND,
    RECIPE_FILE,
    SPACE_FILE,
    Study,
    StudySettings,
    configuration_name,
)
from cluster.bohb.study.journal import (
    JOURNAL_FILES,
    ConfigLine,
    Journal,
    ResultLine,
)
from cluster.bohb.study.profiles import ENDLESS, METHODS
from cluster.nes.view import registered, run_documents
from cluster.pictures import image
from cluster.session.terminal import last_line
from cluster.storage.run_folder import BEST_FILE, Lifetime, Status, finals
from cluster.tracking import Document, Point, RunView, Views


class StudyViews(Views):
    """The MLflow runs of a study. Without a `journal`, its files are read for every view."""

    kind = KIND

    def __init__(self, folder: Path, live: bool = False, journal: Journal | None = None) -> None:
        super().__init__(folder, live)
        self.parent = self.identity.uuid  # key of the study's own run
        self._journal = journal
        self.running: set[str] = set()  # names of the configurations that run

    @cached_property
    def study(self) -> Study:
        """The definition of the study. Raises InvalidInput."""
        return Study.read(self.folder)

    @property
    def journal(self) -> Journal:
        """The journal. Raises InvalidInput."""
        return self._journal or Journal(self.folder)

    def key(self, name: str) -> str:
        """Key of a configuration's run."""
        return f"{self.parent}/{name}"

    def keys(self) -> list[str]:
        """All keys, the study's own first. Raises InvalidInput."""
        names = [configuration_name(line.id) for line in self.journal.configs]
        return [self.parent, *map(self.key, names)]

    def view(self, key: str) -> RunView:
        """View of the run with that key. Raises InvalidInput."""
        journal = self.journal
        if key == self.parent:
            return self._study(journal)
        for line in journal.configs:
            if self.key(configuration_name(line.id)) == key:
                return self._configuration(line, [r for r in journal.results if r.id == line.id])
        raise InvalidInput(f"study {self.study.name!r} has no run {key}")

    def progress(self) -> tuple[str, str]:
        """Number of results, and the incumbent's objective."""
        brackets, results = self.lifetime.target, len(self.journal.results)
        rungs = StudySettings.read(self.folder).schedule.brackets(brackets)
        incumbent = StudySummary.of(self.journal).incumbent
        best = "" if incumbent is None else f"{incumbent.loss:.0f} core s"
        if brackets >= ENDLESS:
            return f"{results} results", best
        total = max(sum(rung.configurations for rung in rungs), results)
        return f"{results}/{total} results", best

    def _study(self, journal: Journal) -> RunView:
        study, ends = self.study, finals(self.folder)
        summary = StudySummary.of(journal, study.schedule.brackets(self.lifetime.target))
        incumbent, settings = summary.incumbent, study.settings()
        params = ("seed", "method", "prior", "budgets", "cycle", "base")
        name = "" if incumbent is None else configuration_name(incumbent.id)
        return self.own_run(
            {
                **{name: settings[name] for name in params},
                "task": study.task.id,
                "space": study.space.name,
            },
            study_points(summary),
            {"bilevel.incumbent": name},
            documents=_documents(study, summary, bool(ends)),
            model=registered(study.folder, study.task.id, ends[-1]) if ends else None,
            description=(
                f"{METHODS[study.method]} over NES on **{study.task.id}**, recipe "
                f"`{study.base.recipe}`, rule `{study.base.nes.update}`: search space "
                f"`{study.space.name}`, budgets {settings['budgets']} core seconds. Each "
                "nested run is one configuration. `objective` is the expected number of core "
                "seconds until fresh agents confirm an SE (lower is better)."
            ),
        )

    def _configuration(self, line: ConfigLine, results: list[ResultLine]) -> RunView:
        study, name = self.study, configuration_name(line.id)
        running = name in self.running
        failure = next((r.exception for r in results if r.exception is not None), None)
        runs = ConfigurationRuns(study, line.id, line.configuration)
        try:
            runs.read()
        except InvalidInput:  # an invalid configuration, which never ran
            if failure is None:
                raise
        tags = {
            "bilevel.kind": "configuration",
            "bilevel.bracket": str(line.id[0]),
            "bilevel.origin": line.origin.value,
        }
        documents: list[Document] = []
        if failure is not None:
            tags["bilevel.error"] = last_line(failure)[:250]
            documents.append(Document.of("error.txt", failure))
        best = runs.best if runs.states else None
        if best is not None and not running:
            document = Document(BEST_FILE, f"generation {runs.generations}", lambda: se_bytes(best))
            run = runs.run(0)
            documents += run_documents(runs.states, run, f"{study.name}, {name}", document)
        points: list[Point] = []
        for number, state in enumerate(runs.states):
            before = len(points)
            points += [Point.of(record, before, run=number) for record in state.records]
        started = self.identity.began if results else time.time()
        if points:
            started = points[0].time - points[0].values["generation_seconds"]
        for result in results:
            if result.loss is not None:
                tally = {name: float(result.info[name]) for name in TALLIED if name in result.info}
                values = {"objective": result.loss, "budget": float(result.budget), **tally}
                points.append(Point(values, result.budget, result.finished))
        ended = max([started, *(p.time for p in points), *(r.finished for r in results)])
        status = "RUNNING" if running else _status(results, runs.tally.cost)
        return RunView(
            self.key(name),
            name,
            Lifetime(status, started, None if running else ended),
            line.configuration,  # configuration.json has all hyperparameters
            tags,
            tuple(points),
            tuple(documents),
            parent=self.parent,
            identity=self.identity,
            description=f"Configuration {name} of the study `{study.name}`.",
        )


def study_points(summary: StudySummary) -> list[Point]:
    """Points of a study's own run; the step is the number of the result, from 1."""
    points = [
        Point({"objective": line.objective, "budget": float(line.budget)}, number, line.finished)
        for number, line in summary.leaders()
    ]
    best: dict[int, float] = {}
    for number, line in enumerate(summary.journal.results, start=1):
        if line.loss is not None and line.loss < best.get(line.budget, np.inf):
            best[line.budget] = line.loss
            points.append(Point({f"best_at_{line.budget}": line.loss}, number, line.finished))
    if summary.validation is not None:
        winner = summary.validation.finalists[0]
        values = {"validated_objective": winner.objective}
        points.append(Point(values, summary.validation.results, winner.finished))
    return points


def _documents(study: Study, summary: StudySummary, ended: bool) -> list[Document]:
    documents = [Document.of_file(study.folder / BEST_FILE)] if ended else []
    journal, incumbent = summary.journal, summary.incumbent
    if not journal.results:
        return documents
    if (study.folder / SPACE_FILE).exists():
        documents.append(Document.of_file(study.folder / SPACE_FILE, "journal/"))
    version = f"{len(journal.results)} results"
    if summary.validation is not None:
        version += f", {summary.validation.results} validated"
        documents.append(Document.of("validation.csv", validation_csv(summary)))

    objectives = partial(pictures.objective_against_cost, summary, study.task, study.name)
    documents += [
        Document("objective_against_cost.png", version, lambda: image(objectives())),
        Document.of("brackets.csv", brackets_csv(summary)),
        Document.of("results.csv", results_csv(summary)),
        *(Document.of_file(study.folder / name, "journal/") for name in JOURNAL_FILES),
    ]
    if incumbent is not None:
        values = journal.proposals[incumbent.id].configuration

        def hyperparameters() -> bytes:
            space, ranked = study.space.build(study.agents), summary.ranked
            proposals = journal.proposals  # after the results: both grow
            figure = pictures.hyperparameters(
                np.array([unit_values(space, proposals[id].configuration) for id in ranked]),
                unit_values(space, values),
                unit_values(space, study.recipe_values),
                tuple(space),
                importance(space, journal),
                f"{study.name}, {study.task.id}",
            )
            return image(figure)

        documents += [
            Document("hyperparameters.png", version, hyperparameters),
            Document.of("incumbent.json", json.dumps(values, indent=2)),
            Document.of(RECIPE_FILE, study.recipe_text(incumbent.id, values)),
        ]
    return documents


def _status(results: list[ResultLine], cost: float) -> Status:
    """MLflow's status of a configuration that does not run and has cost that many core seconds."""
    if any(result.loss is None for result in results):
        return "FAILED"
    spent = max((result.info.get("core_seconds", 0.0) for result in results), default=-1.0)
    return "FINISHED" if spent >= round(cost, 2) else "KILLED"

"""MLflow views of a study: a run with BOHB's results, and a nested run per configuration."""

import json
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bilevel.errors import InvalidInput
from bilevel.synthetic_env import se_bytes
from cluster.bohb.results import pictures
from cluster.bohb.results.importance import importance, unit_values
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.results.tables import TALLIED, brackets_csv, results_csv, validation_csv
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import KIND, RECIPE_FILE, SPACE_FILE, Study, configuration_name
from cluster.bohb.study.journal import ConfigLine, Journal, ResultLine
from cluster.bohb.study.profiles import ENDLESS
from cluster.nes.view import registered, run_documents
from cluster.pictures import png
from cluster.session.terminal import last_line
from cluster.storage.run_folder import BEST_FILE, Lifetime, RunIdentity, Status, finals
from cluster.tracking import Document, Point, Progress, RunView

#: Settings that are parameters of the MLflow run.
_PARAMS = ("seed", "method", "prior", "budgets", "cycle", "base")


@dataclass(frozen=True)
class StudyViews:
    """The MLflow runs of a study.

    `live` while this process works on the study; `running` are the names of the configurations
    that run. Without a `journal`, the study's files are read for every view.
    """

    study: Study
    identity: RunIdentity
    live: bool
    running: set[str] = field(default_factory=set)
    journal: Journal | None = None

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
        configs = self._journal().configs
        return [self.parent, *(self.key(configuration_name(line.id)) for line in configs)]

    def view(self, key: str) -> RunView:
        """View of the run with that key. Raises InvalidInput."""
        journal = self._journal()
        if key == self.parent:
            return self._study(journal)
        for line in journal.configs:
            if self.key(configuration_name(line.id)) == key:
                results = [result for result in journal.results if result.id == line.id]
                return self._configuration(line, results)
        raise InvalidInput(f"study {self.study.name!r} has no run {key}")

    def _journal(self) -> Journal:
        return self.journal or Journal(self.study.folder)

    def _study(self, journal: Journal) -> RunView:
        study, ends = self.study, finals(self.study.folder)
        lifetime = Lifetime.of(study.folder, self.identity.began, self.live)
        summary = StudySummary.of(journal, study.schedule.brackets(lifetime.target))
        incumbent, settings = summary.incumbent, study.settings()
        name = "" if incumbent is None else configuration_name(incumbent.id)
        return RunView(
            self.parent,
            study.name,
            lifetime,
            {
                **{name: settings[name] for name in _PARAMS},
                "task": study.task.id,
                "space": study.space.name,
            },
            {"bilevel.kind": KIND, "bilevel.incumbent": name},
            (*study_points(summary), *(Point.of_final(end) for end in ends)),
            tuple(_documents(study, summary, bool(ends))),
            model=registered(study.folder, study.task.id, ends[-1]) if ends else None,
            identity=self.identity,
            description=(
                f"{study.method_name} over NES on **{study.task.id}**, recipe "
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
        try:
            runs = ConfigurationRuns.read(study, line.id, line.configuration)
        except InvalidInput:
            if failure is None:
                raise
            runs = ConfigurationRuns(study, line.id, line.configuration)  # invalid, so it never ran
        tags = {
            "bilevel.kind": "configuration",
            "bilevel.bracket": str(line.id[0]),
            "bilevel.origin": line.origin.value,
        }
        documents: list[Document] = []
        if failure is not None:
            tags["bilevel.error"] = last_line(failure)[:250]
            documents.append(Document.of_text("error.txt", failure))
        best = runs.best if runs.states else None
        if best is not None and not running:
            document = Document(BEST_FILE, f"generation {runs.generations}", lambda: se_bytes(best))
            title = f"{study.name}, {name}"
            documents += run_documents(runs.states, runs.run(0), title, document)
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
        winner = summary.validation.winner
        values = {"validated_objective": winner.objective}
        points.append(Point(values, summary.validation.results, winner.finished))
    return points


def hyperparameter_picture(study: Study, summary: StudySummary) -> Figure:
    """Plot the values of all configurations, and the importance of each hyperparameter, of a study
    with an incumbent."""
    space, journal, incumbent = study.space.build(study.agents), summary.journal, summary.incumbent
    assert incumbent is not None
    tried = [unit_values(space, summary.configuration(id)) for id in summary.ranked]
    return pictures.hyperparameters(
        np.array(tried),
        unit_values(space, summary.configuration(incumbent.id)),
        unit_values(space, study.of_recipe),
        tuple(space),
        importance(space, journal),
        f"{study.name}, {study.task.id}",
    )


def study_progress(folder: Path, brackets: int) -> Progress:
    """Number of results of a study with that number of brackets, and the incumbent's objective.
    Raises InvalidInput."""
    journal = Journal(folder)
    rungs = Study.schedule_in(folder).brackets(brackets)
    incumbent = StudySummary.of(journal, rungs).incumbent
    best = "" if incumbent is None else f"{incumbent.loss:.0f} core s"
    results = len(journal.results)
    if brackets >= ENDLESS:
        return Progress(f"{results} results", best)
    total = max(sum(rung.configurations for rung in rungs), results)
    return Progress(f"{results}/{total} results", best)


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
        documents.append(Document.of_text("validation.csv", validation_csv(summary)))

    def objectives() -> bytes:
        return png(pictures.objective_against_cost(summary, study.task, study.name))

    documents += [
        Document("objective_against_cost.png", version, objectives),
        Document.of_text("brackets.csv", brackets_csv(summary)),
        Document.of_text("results.csv", results_csv(summary)),
        *(Document.of_file(path, "journal/") for path in journal.paths),
    ]
    if incumbent is not None:
        values = summary.configuration(incumbent.id)
        picture = Document(
            "hyperparameters.png", version, lambda: png(hyperparameter_picture(study, summary))
        )
        documents += [
            picture,
            Document.of_text("incumbent.json", json.dumps(values, indent=2)),
            Document.of_text(RECIPE_FILE, study.recipe_text(incumbent.id, values)),
        ]
    return documents


def _status(results: list[ResultLine], cost: float) -> Status:
    """MLflow's status of a configuration that does not run and has cost that many core seconds."""
    if any(result.loss is None for result in results):
        return "FAILED"
    spent = max((result.info.get("core_seconds", 0.0) for result in results), default=-1.0)
    return "FINISHED" if spent >= round(cost, 2) else "KILLED"

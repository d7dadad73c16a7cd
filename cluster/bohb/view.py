"""MLflow views of a study: one parent run with BOHB's results, one child run per configuration."""

import json
import time
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bilevel.errors import InvalidInput
from bilevel.synthetic_env import se_bytes
from cluster.bohb import pictures
from cluster.bohb.importance import importance, unit_values
from cluster.bohb.journal import ConfigLine, Journal, ResultLine
from cluster.bohb.profiles import ENDLESS
from cluster.bohb.study import KIND, RECIPE_FILE, SPACE_FILE, Study, configuration_name
from cluster.bohb.summary import StudySummary
from cluster.bohb.tables import incumbents_csv, results_csv
from cluster.nes.run import start_of
from cluster.nes.selection import BEST_FILE
from cluster.nes.view import (
    edition,
    generation_points,
    registered,
    run_documents,
)
from cluster.session.terminal import last_line
from cluster.storage.run_folder import RunIdentity, RunStatus, finals
from cluster.tracking import Document, Point, Progress, RunView
from cluster.tracking.pictures import png
from search_spaces import of_hyperparameters


@dataclass(frozen=True)
class StudyViews:
    """The MLflow runs of a study. `live` are the names of running configurations, None if no
    process works on the study."""

    study: Study
    identity: RunIdentity
    live: Container[str] | None

    @classmethod
    def of(cls, folder: Path) -> "StudyViews":
        """Views of a study that no process works on. Raises InvalidInput if it is damaged."""
        return cls(Study.read(folder), RunIdentity.read(folder), None)

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
        run_status = RunStatus.load(study.folder) or RunStatus("KILLED", self.identity.began, 0)
        over = self.live is None or run_status.status != "RUNNING"
        summary = StudySummary(journal, study.schedule.brackets(run_status.target))
        tags = {"bilevel.kind": KIND}
        incumbent = summary.incumbent
        if incumbent is not None:
            tags["bilevel.incumbent"] = configuration_name(incumbent.id)
        points = [
            Point(
                {"objective": line.objective or 0.0, "budget": line.budget},
                number,
                journal.results[number - 1].finished,
            )
            for number, line in summary.incumbents()
        ]
        points += [
            Point({"core_utilisation": line.info["core_utilisation"]}, number, line.finished)
            for number, line in enumerate(journal.results, start=1)
            if "core_utilisation" in line.info
        ]
        return RunView(
            self.parent,
            study.name,
            run_status.ended_as if over else "RUNNING",
            self.identity.began,
            run_status.since if over else None,
            {
                "task": study.task.id,
                "seed": study.seed,
                "space": study.space.name,
                "budgets": list(study.schedule.budgets),
                "cycle": study.schedule.cycle,
                "method": study.method,
                "prior": "recipe" if study.prior else "none",
                "base": study.base.to_dict(),
            },
            tags,
            (*points, *(Point.of_final(end) for end in ends)),
            tuple(self._documents(journal, summary, bool(ends))),
            model=registered(study.folder, study.task.id, ends[-1]) if ends else None,
            author=self.identity.author,
            description=self._description(),
        )

    def _documents(self, journal: Journal, summary: StudySummary, ended: bool) -> list[Document]:
        study = self.study
        documents = [Document.of_file(study.folder / BEST_FILE)] if ended else []
        incumbent = summary.incumbent
        if not journal.results:
            return documents

        def picture() -> bytes:
            return png(pictures.objective_against_cost(summary.points(), study.task, study.name))

        results = f"{len(journal.results)} results"
        documents += [
            Document("objective_against_cost.png", results, picture),
            Document.of_text("brackets.md", summary.bracket_table()),
            Document.of_text("results.csv", results_csv(summary)),
            Document.of_text("incumbents.csv", incumbents_csv(summary)),
            *(Document.of_file(path, "journal/") for path in journal.paths),
        ]
        if (study.folder / SPACE_FILE).exists():
            documents.append(Document.of_file(study.folder / SPACE_FILE, "journal/"))
        if incumbent is not None:
            # While the study runs, at every tenth result: the forest takes half a second.
            number = len(journal.results) if ended else len(journal.results) // 10 * 10
            documents.append(
                Document(
                    "hyperparameters.png",
                    f"{number} results",
                    lambda: self._hyperparameters(summary),
                )
            )
            values = summary.configuration(incumbent.id)
            documents.append(Document.of_text("incumbent.json", json.dumps(values, indent=2)))
            text = study.recipe_text(incumbent.id, values)
            documents.append(Document.of_text(RECIPE_FILE, text))
        return documents

    def _hyperparameters(self, summary: StudySummary) -> bytes:
        """The picture of what was tried, and what it did."""
        study, journal = self.study, summary.journal
        space = study.space.build(study.agents)
        values = {line.id: unit_values(space, line.configuration) for line in journal.configs}
        good = [line for line in journal.results if line.objective is not None]
        width = len(space)
        figure = pictures.hyperparameters(
            np.array([values[line.id] for line in good]).reshape(-1, width),
            np.array([line.objective for line in good], np.float64),
            np.array([values[line.id] for _, line in summary.incumbents()]).reshape(-1, width),
            unit_values(space, of_hyperparameters(study.base, space)),
            tuple(space),
            importance(space, journal),
            f"{study.name}, {study.task.id}",
        )
        return png(figure)

    def _description(self) -> str:
        study = self.study
        return (
            f"{study.method_name} over NES on **{study.task.id}**, recipe "
            f"`{study.base.recipe}`, {start_of(study.base.nes)}, "
            f"rule `{study.base.nes.update}`: search space `{study.space.name}`, "
            f"population {study.base.nes.population_size}, budgets {list(study.schedule.budgets)} "
            f"generations (eta 3), seed {study.seed}. Each child run is one configuration; a "
            "promoted one continues in the same run. `objective`, which is maximised, is the mean "
            "over the run's generations of the mean score of agents trained on the unperturbed "
            "SE: the area under the learning curve. `final_*` are of fresh agents trained on the "
            "best SE of all configurations."
        )

    # -- a configuration's run ---------------------------------------------------

    def _configuration(self, line: ConfigLine, results: list[ResultLine]) -> RunView:
        study, name = self.study, configuration_name(line.id)
        run = study.run(line.id, line.configuration)
        state = run.load_if_sound()
        live = self.live is not None and name in self.live
        tags = {
            "bilevel.kind": "configuration",
            "bilevel.bracket": str(line.id[0]),
            "bilevel.model_based_pick": str(bool(line.info.get("model_based_pick"))).lower(),
        }
        failure = next((r.exception for r in results if r.exception is not None), None)
        documents: list[Document] = []
        if failure is not None:
            tags["bilevel.error"] = last_line(failure)[:250]
            documents.append(Document.of_text("error.txt", failure))
        if state is not None and state.finalists and not live:
            version = f"generation {state.generation}"
            best = Document(BEST_FILE, version, lambda: se_bytes(state.candidates[0]))
            documents += run_documents(run, state, f"{study.name}, {name}", best)
        points = generation_points(state)
        points += [
            Point({"objective": r.objective, "budget": float(r.budget)}, r.budget, r.finished)
            for r in results
            if r.objective is not None
        ]
        times = [point.time for point in points] + [result.finished for result in results]
        started = self.identity.began if results else time.time()
        if state is not None and state.records:
            started = state.records[0].finished - state.records[0].generation_seconds
        return RunView(
            self.key(name),
            name,
            "RUNNING" if live else _status(results, 0 if state is None else state.generation),
            started,
            None if live else max(times, default=started),
            line.configuration,  # and all the rest in configuration.json
            tags,
            tuple(points),
            tuple(documents),
            parent=self.parent,
            edition=edition(state),
            author=self.identity.author,
            description=f"Configuration {name} of the study `{study.name}`.",
        )


def _status(results: list[ResultLine], generations: int) -> str:
    """MLflow status of a configuration's run that no process works on."""
    if any(result.loss is None for result in results):
        return "FAILED"
    reached = max((result.budget for result in results), default=0)
    return "FINISHED" if reached > 0 and generations <= reached else "KILLED"


def study_progress(folder: Path, brackets: int) -> Progress:
    """Number of results, and the incumbent's objective, of a study of so many brackets. Raises
    InvalidInput."""
    journal = Journal(folder)
    rungs = Study.read(folder).schedule.brackets(brackets)
    incumbent = StudySummary(journal, rungs).incumbent
    best = "" if incumbent is None else f"{incumbent.objective:.1f}"
    results = len(journal.results)
    if brackets >= ENDLESS:
        return Progress(f"{results} results", best)
    total = max(sum(rung.configurations for rung in rungs), results)
    return Progress(f"{results}/{total} results", best)

"""What a study reports while it runs: lines in the terminal, runs in MLflow.

A Ray Tune callback in the driver, the only one who writes to MLflow.
"""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ray.tune import Callback

from bilevel.errors import InvalidInput
from bilevel.nes import GenerationRecord, NESState
from bilevel.synthetic_env import save_se
from cluster.bohb.brackets import bracket_table
from cluster.bohb.journal import ConfigLine, Journal
from cluster.bohb.search import Job
from cluster.bohb.searcher import BUDGET_REACHED, OBJECTIVE, BohbSearcher, DriverOnly
from cluster.bohb.summary import StudySummary
from cluster.bohb.trial import configuration_name, configuration_run
from cluster.final import BEST_FILE, LAST_FILE, Contender, FinalScore, hand_over
from cluster.nes_loop import NESRun
from cluster.progress import Terminal, duration
from cluster.tracking import Tracker, plots

if TYPE_CHECKING:
    from cluster.bohb.study import StudySettings

#: SEs that are retested at the end of a study.
_CONTENDERS = 6

#: Seconds between refreshed pictures on the parent run.
_PICTURE_EVERY = 20.0


class StudyReport(DriverOnly, Callback):  # type: ignore[misc]
    """Follows the trials of one study."""

    def __init__(
        self,
        settings: "StudySettings",
        identity: str,
        journal: Journal,
        searcher: BohbSearcher,
        tracker: Tracker,
        terminal: Terminal,
        brackets: int,
    ) -> None:
        self._settings = settings
        self._identity = identity
        self._journal = journal
        self._searcher = searcher
        self._tracker = tracker
        self._terminal = terminal
        self._rungs = bracket_table(brackets, settings.ladder)
        self._summary = StudySummary(journal, self._rungs)
        self._brackets = brackets
        self._jobs: dict[str, Job] = {}  # by trial
        self._runs: dict[str, str] = {}  # MLflow run by configuration name
        self._last_picture = 0.0
        self._started = time.monotonic()
        self._generations = 0  # run by this process
        self._parent = ""

    # -- the study ------------------------------------------------------------

    def begin(self, trials: int) -> None:
        """Open the parent run and say what is going to happen."""
        s = self._settings
        params = {
            "task": s.task.id,
            "seed": s.seed,
            "profile": s.profile_name,
            "space": s.profile.space,
            "budgets": s.ladder,
            "base": s.base.to_dict(),
        }
        self._parent = self._tracker.open_run(
            self._identity,
            s.name,
            params,
            {"bilevel.kind": "study"},
            description=self._description(),
        )
        line = self._terminal.line
        line(
            f"BOHB on {s.task.id}: study {s.name!r}, profile {s.profile_name}, space "
            f"{s.profile.space}, population {s.profile.population}, budgets "
            f"{'/'.join(map(str, s.ladder))} generations, {trials} trial(s) at a time with "
            f"{s.workers_per_trial} worker(s) each"
        )
        line(f"folder {s.folder}; to look at it: {self._tracker.address}")
        if s.profile.time_budget is not None:
            line(f"time budget {duration(s.profile.time_budget)}")
        if self._journal.results:
            line(f"going on: {len(self._journal.results)} results of this study count already")

    def contenders(self) -> list[Contender]:
        """The SEs whose own agents scored highest, of all configurations, best first."""
        found = []
        for line in self._journal.configs:
            run = self._run(line)
            try:
                state = run.load()
            except InvalidInput as error:
                self._terminal.line(f"{error}; it is left out")
                continue
            if state is not None:
                ses = run.finalists(state)
                found += [
                    (f.rank, Contender(se, run.hp))
                    for f, se in zip(state.finalists, ses, strict=True)
                ]
        found.sort(key=lambda pair: pair[0], reverse=True)
        return [contender for _, contender in found[:_CONTENDERS]]

    def finish(self, best: Contender, score: FinalScore) -> None:
        """Report the incumbent, and the best SE with its fresh score."""
        s = self._settings
        self._pictures(force=True)
        path, address = hand_over(best.se, score, s.folder, self._tracker, self._parent)
        line = self._terminal.line
        line(
            f"{len(self._journal.results)} results of {len(self._journal.configs)} configurations "
            f"({self._summary.model_based} proposed by the model)"
        )
        line(
            f"evaluations took {self._searcher.core_utilisation:.0%} of the cores' time while "
            "trials ran"
        )
        incumbent = self._summary.incumbent
        if incumbent is not None:
            values = self._summary.configuration(incumbent.id)
            line(
                f"incumbent {configuration_name(incumbent.id)}: objective "
                f"{incumbent.objective:.1f} over {incumbent.budget} generations"
            )
            for name, value in values.items():
                line(
                    f"  {name} = {value:.6g}" if isinstance(value, float) else f"  {name} = {value}"
                )
        line(str(score))
        line(f"best SE: {path}  ({address} in MLflow's model registry)")
        line("look at everything with `make ui`; the same command adds brackets to the study")

    def close(self, status: str) -> None:
        """Leave no run marked as running."""
        for trial_id in list(self._jobs):
            self._close_trial(trial_id, "KILLED")
        self._pictures(force=True)
        self._tracker.close_run(self._parent, status)

    # -- trials (called by Ray Tune) -------------------------------------------

    def on_trial_start(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Open the configuration's run (again, if it was promoted)."""
        job = self._searcher.jobs[trial.trial_id]
        self._jobs[trial.trial_id] = job
        name = configuration_name(job.id)
        run = self._run(ConfigLine(job.id, job.configuration, {}))
        self._runs[name] = self._tracker.open_run(
            f"{self._identity}/{name}",
            f"{self._settings.name}/{name}",
            {**run.hp.to_dict(), "seed": run.seed, "task": run.task.id},
            {
                "bilevel.kind": "configuration",
                "bilevel.bracket": str(job.id[0]),
                "bilevel.model_based_pick": str(job.model_based).lower(),
            },
            parent=self._parent,
        )

    def on_trial_result(
        self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
    ) -> None:
        """Log the generation."""
        job = self._jobs[trial.trial_id]
        run_id = self._runs[configuration_name(job.id)]
        records = [GenerationRecord(**record) for record in result["records"]]
        self._tracker.log_generations(run_id, records)
        self._generations += 1
        self._show(job, records[-1])

    def on_trial_complete(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Log the result of the job, and refresh the pictures."""
        job = self._jobs[trial.trial_id]
        result = trial.last_result or {}
        if not result.get(BUDGET_REACHED):
            self._close_trial(trial.trial_id, "KILLED")
            return
        run_id = self._runs[configuration_name(job.id)]
        objective = float(result[OBJECTIVE])
        self._tracker.log_metrics(
            run_id, {"objective": objective, "budget": job.budget}, job.budget
        )
        run = self._run(ConfigLine(job.id, job.configuration, {}))
        state = run.load()
        assert state is not None
        self._log_ses(run, state, run_id)
        self._close_trial(trial.trial_id, "FINISHED")
        self._result_line(job, objective, state)
        self._pictures()

    def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        """Record the failure; the configuration counts as the worst."""
        job = self._jobs.get(trial.trial_id)
        if job is None:
            return
        reason = Path(trial.error_file).read_text().strip()
        run_id = self._runs[configuration_name(job.id)]
        self._tracker.log_text(run_id, reason, "error.txt")
        self._tracker.set_tags(run_id, {"bilevel.error": reason.splitlines()[-1][:250]})
        self._close_trial(trial.trial_id, "FAILED")
        self._terminal.line(f"{configuration_name(job.id)} failed: {reason.splitlines()[-1]}")

    # -- parts -------------------------------------------------------------------

    def _run(self, line: ConfigLine) -> NESRun:
        s = self._settings
        return configuration_run(line.id, line.configuration, s.task, s.base, s.seed, s.folder)

    def _close_trial(self, trial_id: str, status: str) -> None:
        job = self._jobs.pop(trial_id)
        self._tracker.close_run(self._runs[configuration_name(job.id)], status)

    def _log_ses(self, run: NESRun, state: NESState, run_id: str) -> None:
        for name, se in ((BEST_FILE, run.finalists(state)[0]), (LAST_FILE, run.last_se(state))):
            save_se(se, run.folder / name)
            self._tracker.log_file(run_id, run.folder / name)
        title = f"{self._settings.name}, {run.folder.name}"
        figure = plots.learning_curve(state.records, run.task, title)
        self._tracker.log_figure(run_id, figure, "learning_curve.png")
        self._tracker.log_json(run_id, run.hp.to_dict(), "configuration.json")

    def _show(self, job: Job, record: GenerationRecord) -> None:
        note = (
            f"{configuration_name(job.id)} generation {record.generation + 1}/{job.budget} "
            f"score {record.score_mean:.1f}, "
            f"{record.env_steps_per_second / 1000:.0f}k steps/s a core, ETA {self._eta()}"
        )
        done = len(self._journal.results)
        total = sum(rung.configurations for rung in self._rungs)
        self._terminal.bar(
            f"bracket {job.id[0] + 1}/{self._brackets}", done, total, "results", note
        )

    def _result_line(self, job: Job, objective: float, state: NESState) -> None:
        rungs = [rung.budget for rung in self._rungs if rung.bracket == job.id[0]]
        incumbent = self._summary.incumbent
        so_far = "" if incumbent is None else f"incumbent {incumbent.objective:.1f}"
        self._terminal.line(
            f"{configuration_name(job.id)}  bracket {job.id[0] + 1}/{self._brackets} rung "
            f"{rungs.index(job.budget) + 1}/{len(rungs)}  {job.budget:3d} generations  "
            f"objective {objective:7.1f}  best score {state.best_score:7.1f}  "
            f"{state.records[-1].env_steps_per_second / 1000:3.0f}k steps/s  "
            f"{'model ' if job.model_based else 'random'}  {so_far}  ETA {self._eta()}"
        )

    def _eta(self) -> str:
        elapsed = time.monotonic() - self._started
        left = self._summary.generations_left()
        estimate = elapsed / max(self._generations, 1) * left
        budget = self._settings.profile.time_budget
        if budget is not None:
            estimate = min(estimate, budget - elapsed)
        return duration(estimate)

    def _pictures(self, force: bool = False) -> None:
        now = time.monotonic()
        if not self._journal.results or (now - self._last_picture < _PICTURE_EVERY and not force):
            return
        self._last_picture = now
        tracker, parent = self._tracker, self._parent
        points = self._summary.points()
        figure = plots.objective_against_cost(points, self._settings.task, self._settings.name)
        tracker.log_figure(parent, figure, "objective_against_cost.png")
        tracker.log_text(parent, self._summary.bracket_table(), "brackets.md")
        for path in self._journal.paths:
            tracker.log_file(parent, path, "journal")
        utilisation = {"core_utilisation": self._searcher.core_utilisation}
        tracker.log_metrics(parent, utilisation, len(self._journal.results))
        incumbent = self._summary.incumbent
        if incumbent is not None:
            values = {
                "incumbent_objective": incumbent.objective or 0.0,
                "incumbent_budget": incumbent.budget,
            }
            tracker.log_metrics(parent, values, len(self._journal.results))
            tracker.set_tags(parent, {"bilevel.incumbent": configuration_name(incumbent.id)})
            tracker.log_json(parent, self._summary.configuration(incumbent.id), "incumbent.json")

    def _description(self) -> str:
        s = self._settings
        return (
            f"BOHB over NES on **{s.task.id}**: search space `{s.profile.space}`, population "
            f"{s.profile.population}, budgets {s.ladder} generations (eta 3), seed {s.seed}. "
            "Each child run is one configuration; a promoted one goes on in the same run. "
            "`objective` is the mean over the run's generations of each generation's score (the "
            "area under the learning curve), so that fast and good both count; BOHB maximises "
            "it. `final_*` are of fresh agents trained on the best SE of all configurations."
        )

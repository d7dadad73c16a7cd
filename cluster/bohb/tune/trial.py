"""One trial: the NES runs of a configuration up to a budget, with their own actor pool.

Ray Tune places the trial and its pool together, in one placement group: an empty
bundle for the trial itself, which mostly waits, and a core for each worker.

A trial whose process or node dies is started again and resumes from its checkpoint. An error
raised by the run is retried here and then reported, so that the searcher can tell it from a death.
"""

import socket
import traceback
from typing import Any

from ray import tune

from bilevel.errors import StorageFailure
from bilevel.user_code import Mistake
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import Study
from cluster.ray.pool import EvaluationPool
from cluster.storage.run_folder import SETTINGS_FILE

#: Key of a trial's job, in its configuration.
JOB = "job"
#: Keys of a trial's reports.
OBJECTIVE, BUDGET_REACHED, FAILURE = "objective", "budget_reached", "failure"
#: Keys of the generation's record, or None, and of what the objective rests on, a `Tally`. (As they
#: are: Tune would flatten dictionaries.)
RECORD, TALLY = "record", "tally"
#: Keys of lines for the terminal, and of the core seconds (estimated) that this job has spent.
MESSAGES, SPENT = "messages", "spent"
#: Keys of reports that end the study, a mistake unless other configurations have succeeded.
NO_STORAGE, MISTAKE = "no_storage", "mistake"
#: Key of the measured seconds that the job has spent in evaluations so far.
EVALUATION_SECONDS = "evaluation_seconds"

#: Errors of one step after which the configuration counts as failed.
_ATTEMPTS = 3


class NESTrial(tune.Trainable):  # type: ignore[misc]
    """Ray Tune trial whose step is one generation; the first resumes from checkpoints, if any."""

    def setup(self, config: dict[str, Any], study: Study, workers: int) -> None:
        self._study = study
        self._pool = EvaluationPool(workers)
        self.reset_config(config)

    def reset_config(self, new_config: dict[str, Any]) -> bool:
        """Take the next job; the pool is reused."""
        self._job = new_config[JOB]
        self._runs: ConfigurationRuns | None = None
        self._spent_before: float | None = None  # by the configuration, before this job
        self._evaluation_seconds_before = self._pool.evaluation_seconds
        return True

    def step(self) -> dict[str, Any]:
        """Run one generation and return its record, or the error."""
        for _ in range(_ATTEMPTS):
            try:
                return self._generation()
            except StorageFailure as error:
                return {NO_STORAGE: str(error), "done": True}
            except Mistake as error:
                return {MISTAKE: str(error), "done": True}
            except Exception:
                failure = traceback.format_exc()
                self._runs = None
        return {FAILURE: failure, "done": True}

    def _generation(self) -> dict[str, Any]:
        study, job = self._study, self._job
        if not (study.folder / SETTINGS_FILE).exists():
            node = socket.gethostname()
            raise StorageFailure(f"node {node} does not see the folder {str(study.folder)!r}")
        messages: list[str] = []
        runs = self._runs or ConfigurationRuns.open(
            study, tuple(job["id"]), job["configuration"], messages.append
        )
        if self._spent_before is None:
            self._spent_before = runs.tally.cost
        record = None
        while record is None and not runs.spent(job["budget"]):
            before = runs.generations
            state = runs.advance(self._pool)  # a generation, or a round before or after one
            if runs.generations > before:
                record = state.records[-1]
        self._runs = runs
        tally, reached = runs.tally, runs.spent(job["budget"])
        return {
            RECORD: record,
            MESSAGES: messages,
            OBJECTIVE: tally.objective,
            TALLY: tally,
            SPENT: tally.cost - self._spent_before,
            BUDGET_REACHED: reached,
            EVALUATION_SECONDS: self._pool.evaluation_seconds - self._evaluation_seconds_before,
            "done": reached,
        }

    def save_checkpoint(self, checkpoint_dir: str) -> None:
        """Do nothing: the run's state is in the study's folder."""

    def load_checkpoint(self, checkpoint: Any) -> None:
        """Do nothing: see `save_checkpoint`."""

    def cleanup(self) -> None:
        """End the pool."""
        self._pool.close()

"""One trial: the NES runs of a configuration up to a budget, with their own actor pool.

Tune places the trial and its pool in one placement group: an empty bundle for the trial itself,
which mostly waits, and a core for each worker. The job of a trial whose process or node dies is
suggested again and resumes from its checkpoints. An error in the run is reported as a result, so
that the searcher can distinguish it from a crash.
"""

import socket
import traceback
from dataclasses import dataclass
from typing import Any

from ray import tune

from bilevel.errors import StorageFailure
from bilevel.user_code import UserCodeError
from cluster.bohb.search.objective import Tally
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import Study
from cluster.ray.pool import EvaluationPool, NoActorStarts
from cluster.storage.run_folder import SETTINGS_FILE
from cluster.tracking import Point

#: Key of a trial's job in its configuration, and of the `TrialReport` in its results.
JOB, REPORT = "job", "report"


@dataclass(frozen=True)
class TrialReport:
    """State of a trial after a step."""

    tally: Tally | None = None  # None if the step failed
    budget_reached: bool = False
    point: Point | None = None  # of the generation that the step completed
    error: Exception | None = None  # ends the job; of an unknown kind: RuntimeError(traceback)


class NESTrial(tune.Trainable):  # type: ignore[misc]
    """Ray Tune trial whose step is one generation. The first step resumes from checkpoints."""

    def setup(self, config: dict[str, Any], study: Study, workers: int) -> None:
        """Create the pool and take the first job."""
        self._study = study
        self._pool = EvaluationPool(workers)
        self.reset_config(config)

    def reset_config(self, new_config: dict[str, Any]) -> bool:
        """Take the next job and reuse the pool."""
        self._job = new_config[JOB]
        self._runs: ConfigurationRuns | None = None
        return True

    def step(self) -> dict[str, Any]:
        """Run one generation and return its report."""
        try:
            report = self._generation()
        except (StorageFailure, UserCodeError) as error:
            report = TrialReport(error=error)
        except NoActorStarts:  # ends this process like a crash, so that the job runs elsewhere
            raise
        except Exception:
            report = TrialReport(error=RuntimeError(traceback.format_exc()))
        return {REPORT: report, "done": report.budget_reached or report.error is not None}

    def _generation(self) -> TrialReport:
        study, job = self._study, self._job
        if not (study.folder / SETTINGS_FILE).exists():
            node = socket.gethostname()
            raise StorageFailure(f"node {node} does not see the folder {str(study.folder)!r}")
        if self._runs is None:
            self._runs = ConfigurationRuns(study, tuple(job["id"]), job["configuration"]).read()
        runs = self._runs
        point = None
        while point is None and not runs.spent(job["budget"]):
            generations = runs.generations
            state = runs.advance(self._pool)  # a generation, or a round before or after one
            if runs.generations > generations:
                run = next(i for i, other in enumerate(runs.states) if other is state)
                before = sum(earlier.generation for earlier in runs.states[:run])
                point = Point.of(state.records[-1], before, run=run)
        return TrialReport(runs.tally, runs.spent(job["budget"]), point)

    def cleanup(self) -> None:
        """Stop the pool."""
        self._pool.close()

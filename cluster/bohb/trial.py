"""One trial: an NES run up to a budget, with an actor pool of its own.

Ray Tune places the trial and its pool together, in one placement group: an empty
bundle for the trial itself, which mostly waits, and a core for each worker.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from ray import tune

from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NESState
from bilevel.tasks import Task
from cluster.bohb.journal import ConfigId
from cluster.bohb.searcher import BUDGET_REACHED, KERNEL_SECONDS, OBJECTIVE
from cluster.nes_loop import NESRun
from cluster.pool import EvaluationPool
from search_spaces import to_hyperparameters


def configuration_name(config_id: ConfigId) -> str:
    """`bracket-rung-number`, zero-padded so that names sort."""
    bracket, rung, number = config_id
    return f"{bracket:03d}-{rung}-{number:03d}"


def configuration_run(
    config_id: ConfigId,
    configuration: dict[str, Any],
    task: Task,
    base: Hyperparameters,
    study_seed: int,
    study_folder: Path,
) -> NESRun:
    """The NES run of a configuration; its seed is derived from the study's."""
    seed = int(np.random.SeedSequence([study_seed, *config_id]).generate_state(1)[0])
    folder = study_folder / "configurations" / configuration_name(config_id)
    return NESRun(task, to_hyperparameters(base, configuration), seed, folder)


class NESTrial(tune.Trainable):  # type: ignore[misc]
    """A step is a generation; the first continues from the checkpoint, if any."""

    def setup(
        self,
        config: dict[str, Any],
        task: Task,
        base: Hyperparameters,
        study_seed: int,
        study_folder: Path,
        workers: int,
    ) -> None:
        self._fixed = (task, base, study_seed, study_folder)
        self._pool = EvaluationPool(workers)
        self.reset_config(config)

    def reset_config(self, new_config: dict[str, Any]) -> bool:
        """Take the next job; the pool, started once, serves it too."""
        job = new_config["job"]
        self._budget = int(job["budget"])
        self._run = configuration_run(tuple(job["id"]), job["configuration"], *self._fixed)
        self._state: NESState | None = None
        self._kernel_seconds_before = self._pool.kernel_seconds
        return True

    def step(self) -> dict[str, Any]:
        """Run one generation and report its record (the first step reports all)."""
        first = self._state is None
        state = self._state or self._run.open(self._pool)
        if state.generation < self._budget:
            state = self._run.advance(state, self._pool)
        self._state = state
        reached = state.generation >= self._budget
        records = state.records if first else state.records[-1:]
        return {
            "records": [asdict(record) for record in records],
            OBJECTIVE: state.objective,
            BUDGET_REACHED: reached,
            KERNEL_SECONDS: self._pool.kernel_seconds - self._kernel_seconds_before,
            "done": reached,
        }

    def save_checkpoint(self, checkpoint_dir: str) -> None:
        """Nothing for Tune to keep: the run's state is in the study's folder."""

    def load_checkpoint(self, checkpoint: Any) -> None:
        """Nothing: see `save_checkpoint`."""

    def cleanup(self) -> None:
        """End the pool."""
        self._pool.close()

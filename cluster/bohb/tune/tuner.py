"""Runs the jobs of a study as Ray Tune trials."""

import logging
import os
import shutil
from typing import Any

from ray import tune

from cluster.bohb.study.definition import Study
from cluster.bohb.tune.searcher import BohbSearcher, DriverOnly
from cluster.bohb.tune.trial import NESTrial
from cluster.ray.connection import environment_kept
from cluster.session.interrupts import InterruptGuard

#: Folder of Tune's own files within the study's folder; the study never reads them.
_FOLDER = "ray"
#: Settings of Tune that have no parameter (see the package's docstring for the reasons).
_ENVIRONMENT = {
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
    "TUNE_DISABLE_SIGINT_HANDLER": "1",
    "TUNE_GLOBAL_CHECKPOINT_S": "3600",
}


class _Stopper(DriverOnly, tune.Stopper):  # type: ignore[misc]
    """Stops all trials at the deadline, after an error such as a full disk, or after Ctrl-C."""

    def __init__(self, searcher: BohbSearcher, guard: InterruptGuard) -> None:
        self._searcher = searcher
        self._guard = guard

    def __call__(self, trial_id: str, result: dict[str, Any]) -> bool:
        return False  # never stop a single trial

    def stop_all(self) -> bool:
        searcher = self._searcher
        return self._guard.interrupted or searcher.time_is_up or searcher.stopped_by is not None


def run_trials(
    study: Study, workers_per_trial: int, searcher: BohbSearcher, guard: InterruptGuard
) -> None:
    """Run the searcher's jobs until it has no more, its deadline, an error, or Ctrl-C."""
    trainable = tune.with_parameters(NESTrial, study=study, workers=workers_per_trial)
    bundles: list[dict[str, float]] = [{}, *({"CPU": 1.0} for _ in range(workers_per_trial))]
    shutil.rmtree(study.folder / _FOLDER, ignore_errors=True)
    for name in ("ray.tune", "hpbandster"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with environment_kept(*_ENVIRONMENT):
        os.environ.update(_ENVIRONMENT)
        tune.Tuner(
            tune.with_resources(trainable, tune.PlacementGroupFactory(bundles)),
            tune_config=tune.TuneConfig(search_alg=searcher, num_samples=-1, reuse_actors=True),
            run_config=tune.RunConfig(
                name=_FOLDER,
                storage_path=str(study.folder),
                stop=_Stopper(searcher, guard),
                checkpoint_config=tune.CheckpointConfig(checkpoint_at_end=False),
                failure_config=tune.FailureConfig(max_failures=0),
                verbose=0,
            ),
        ).fit()
    shutil.rmtree(study.folder / _FOLDER, ignore_errors=True)

"""Runs the jobs of a study as Ray Tune trials."""

import logging
import os
import shutil

from ray import tune

from cluster.bohb.study.definition import Study
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.searcher import BohbSearcher
from cluster.bohb.tune.stopping import StudyStopper
from cluster.bohb.tune.trial import NESTrial
from cluster.ray.connection import environment_kept

#: Folder of Tune's own files within the study's folder; the study never reads them.
_FOLDER = "ray"
#: Settings of Tune that have no parameter (see the package's docstring for the reasons).
_ENVIRONMENT = {
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
    "TUNE_DISABLE_SIGINT_HANDLER": "1",
    "TUNE_GLOBAL_CHECKPOINT_S": "3600",
}


def run_trials(
    study: Study,
    workers_per_trial: int,
    searcher: BohbSearcher,
    stopper: StudyStopper,
    report: StudyReport,
) -> None:
    """Run the searcher's jobs until it has no more, or the stopper stops all trials."""
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
                callbacks=[report],
                stop=stopper,
                checkpoint_config=tune.CheckpointConfig(checkpoint_at_end=False),
                failure_config=tune.FailureConfig(max_failures=0),
                verbose=0,
            ),
        ).fit()
    shutil.rmtree(study.folder / _FOLDER, ignore_errors=True)

"""Ray Tune for a study: Tune only places trials; the study keeps its own state."""

import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from ray import tune

from cluster.bohb.study.definition import Study
from cluster.bohb.tune.report import StudyReport
from cluster.bohb.tune.searcher import BohbSearcher
from cluster.bohb.tune.stopping import StudyStopper
from cluster.bohb.tune.trial import NESTrial
from cluster.ray.environment import environment_kept

#: Folder of Tune's own files within the study's folder; the study never reads them.
_TUNES_FOLDER = "ray"


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
    resources = tune.PlacementGroupFactory(bundles)
    shutil.rmtree(study.folder / _TUNES_FOLDER, ignore_errors=True)
    with _quiet_tune():
        tune.Tuner(
            tune.with_resources(trainable, resources),
            tune_config=tune.TuneConfig(search_alg=searcher, num_samples=-1, reuse_actors=True),
            run_config=tune.RunConfig(
                name=_TUNES_FOLDER,
                storage_path=str(study.folder),
                callbacks=[report],
                stop=stopper,
                # NESRun writes its own checkpoint after every generation; a restarted
                # trial continues from it.
                checkpoint_config=tune.CheckpointConfig(checkpoint_at_end=False),
                # The searcher puts the job of a dead trial back into its queue.
                failure_config=tune.FailureConfig(max_failures=0),
                verbose=0,
            ),
        ).fit()
    shutil.rmtree(study.folder / _TUNES_FOLDER, ignore_errors=True)


@contextmanager
def _quiet_tune() -> Iterator[None]:
    """Disable Tune's own files, messages and signal handling.

    Journal and checkpoints hold the study's state, `StudyReport` prints its messages, and
    `InterruptGuard` handles Ctrl-C.
    """
    for name in ("ray.tune", "hpbandster"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    wanted = {
        "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
        "TUNE_DISABLE_SIGINT_HANDLER": "1",
        "TUNE_DISABLE_STRICT_METRIC_CHECKING": "1",
        "TUNE_MAX_PENDING_TRIALS_PG": "1",
        "TUNE_GLOBAL_CHECKPOINT_S": "3600",
        "TUNE_RESULT_BUFFER_LENGTH": "0",
    }
    with environment_kept(*wanted):
        os.environ.update(wanted)
        yield

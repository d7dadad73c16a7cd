"""The registry of kinds of runs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bilevel.errors import one_of
from cluster.bohb.study.definition import KIND as STUDY
from cluster.bohb.view import StudyViews, study_progress
from cluster.evaluate.run import KIND as EVALUATION
from cluster.evaluate.view import EvaluationViews, evaluation_progress
from cluster.experiments.run import KIND as EXPERIMENT
from cluster.experiments.view import ExperimentViews, experiment_progress
from cluster.nes.run import KIND as NES
from cluster.nes.view import NESViews, nes_progress
from cluster.storage.run_folder import read_settings
from cluster.tracking import Progress, Views


@dataclass(frozen=True)
class Kind:
    """Readers of run folders of one kind, which raise InvalidInput for a damaged folder. `progress`
    also takes the run's target."""

    views: Callable[[Path], Views]
    progress: Callable[[Path, int], Progress]


#: All kinds by their name in a run's settings.
KINDS = {
    STUDY: Kind(StudyViews.of, study_progress),
    NES: Kind(NESViews.of, nes_progress),
    EVALUATION: Kind(EvaluationViews.of, evaluation_progress),
    EXPERIMENT: Kind(ExperimentViews.of, experiment_progress),
}


def kind_of(folder: Path) -> str:
    """Name of the kind of run in a folder. Raises InvalidInput for a damaged folder."""
    kind = str(read_settings(folder).get("kind"))
    if kind not in KINDS:
        raise one_of("kind of run", kind, KINDS)
    return kind


def views_of(folder: Path) -> Views:
    """Views of a folder that no process works on. Raises InvalidInput for a damaged folder."""
    return KINDS[kind_of(folder)].views(folder)

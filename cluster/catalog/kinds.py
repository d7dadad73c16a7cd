"""The registry of kinds of runs."""

from pathlib import Path

from bilevel.errors import unknown_value
from cluster.bohb.view import StudyViews
from cluster.evaluate.run import EvaluationViews
from cluster.experiments.run import ExperimentViews
from cluster.nes.view import NESViews
from cluster.storage.run_folder import read_settings
from cluster.tracking import Views

#: Views of all kinds of runs, by the kind's name in a run's settings.
KINDS: dict[str, type[Views]] = {
    views.kind: views for views in (StudyViews, NESViews, EvaluationViews, ExperimentViews)
}


def views_of(folder: Path) -> Views:
    """Views of a folder that no process works on. Raises InvalidInput for a damaged folder."""
    kind = str(read_settings(folder).get("kind"))
    if kind not in KINDS:
        raise unknown_value("kind of run", kind, KINDS)
    return KINDS[kind](folder)

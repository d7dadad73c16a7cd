"""The kinds of runs, and the MLflow views of their folders."""

from collections.abc import Callable
from pathlib import Path

from bilevel.errors import one_of
from cluster.bohb.study import KIND as STUDY_KIND
from cluster.bohb.view import StudyViews
from cluster.evaluate.view import KIND as EVALUATION_KIND
from cluster.evaluate.view import EvaluationViews
from cluster.nes.run import KIND as NES_KIND
from cluster.nes.view import NESViews
from cluster.storage.run_folder import read_settings
from cluster.tracking import Views


def views_of(folder: Path) -> Views:
    """The views of a folder that no process works on. Raises InvalidInput for a damaged folder."""
    kinds: dict[str, Callable[[Path], Views]] = {
        STUDY_KIND: StudyViews.of,
        NES_KIND: NESViews.of,
        EVALUATION_KIND: EvaluationViews.of,
    }
    kind = str(read_settings(folder).get("kind"))
    if kind not in kinds:
        raise one_of("kind of run", kind, kinds)
    return kinds[kind](folder)

"""Studies and NES runs as MLflow shows them, made from their folders alone."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from bilevel.errors import one_of
from cluster.nes_loop import KIND as NES_KIND
from cluster.run_folder import read_settings
from cluster.tracking import RunView
from cluster.views.evaluation import KIND as EVALUATION_KIND
from cluster.views.evaluation import EvaluationViews
from cluster.views.nes import NESViews
from cluster.views.study import KIND as STUDY_KIND
from cluster.views.study import StudyViews

__all__ = ["EvaluationViews", "NESViews", "StudyViews", "Views", "views_of"]


class Views(Protocol):
    """The runs that a folder is shown as."""

    @property
    def task_id(self) -> str:
        """The task, whose experiment they belong to."""

    def keys(self) -> list[str]:
        """Their keys, parents first."""

    def view(self, key: str) -> RunView:
        """The run with that key, from what is on disk now. Raises InvalidInput."""


def views_of(folder: Path) -> Views:
    """The views of a folder that nobody works on. Raises InvalidInput."""
    kinds: dict[object, Callable[[Path], Views]] = {
        STUDY_KIND: StudyViews.of,
        NES_KIND: NESViews.of,
        EVALUATION_KIND: EvaluationViews.of,
    }
    kind = read_settings(folder).get("kind")
    if kind not in kinds:
        raise one_of("kind of run", kind, kinds)
    return kinds[kind](folder)

"""Writes views to MLflow: one experiment per task, one run per run folder, and a nested run per
configuration of a study. A tag holds the run's key.

    show(view):
        run <- the run with the view's key, created if missing
        for each of params, points, documents, model, tags, status:
            write the part that the run lacks
"""

import copy
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from bilevel.errors import first_line
from cluster.storage.author import without_password
from cluster.storage.run_folder import RunIdentity
from cluster.tracking.connection import connected
from cluster.tracking.experiment import NOTE, experiment_of, runs_page
from cluster.tracking.run import MLflowRun
from cluster.tracking.view import Point, RunView

#: Tag with the run's key.
KEY = "bilevel.key"


class Incomplete(Exception):
    """MLflow lacks a run, or parts of it, that it rejects or that cannot be created."""


class Tracker:
    """Writes the runs of one task to an MLflow server or database.

    `artifacts` is the folder of artifacts if `uri` is a database, which stores no files. A
    `thorough` tracker uploads every document again, whatever the run's tags say. Raises
    InvalidInput if MLflow cannot be reached.
    """

    def __init__(self, uri: str, task_id: str, artifacts: Path, thorough: bool = False) -> None:
        self.uri = uri
        self._thorough = thorough
        self._runs: dict[str, MLflowRun] = {}
        location = (artifacts / task_id).resolve().as_uri() if self.server is None else None
        with connected(uri) as self._client:
            self.experiment_id = experiment_of(self._client, task_id, location)

    def another(self) -> Self:
        """Return a tracker of the same task and MLflow for another thread. It does not connect, so
        MLflow may be unreachable."""
        other = copy.copy(self)
        other._runs = {}
        return other

    @property
    def server(self) -> str | None:
        """Address of the MLflow server; None for a database."""
        return self.uri.rstrip("/") if self.uri.startswith("http") else None

    def page(self, key: str | None = None) -> str:
        """Path of the UI's page of the run with that key, or of all runs of the task."""
        run_id = None
        if key is not None:
            with suppress(Exception):  # MLflow is unreachable
                run_id = self._run_id(key)
        return runs_page(self.experiment_id, run_id)

    def show(self, view: RunView) -> None:
        """Write the parts of the view that MLflow lacks.

        Raises Incomplete after everything else is written, and MLflow's exceptions if it is
        unreachable; repeating the call completes the run.
        """
        from mlflow.exceptions import MlflowException

        run = self._runs.pop(view.key, None)
        try:
            if run is None or run.contradicts(view.points):
                run = self._open(view)
            missing = run.complete(view)
        except MlflowException as error:
            if not _rejected(error):
                raise
            reason = without_password(first_line(error))
            raise Incomplete(f"{view.name}: MLflow rejects the run ({reason})") from None
        self._runs[view.key] = run  # after a failed write, the run is read again
        if missing:
            raise Incomplete(f"{view.name}: MLflow lacks {', '.join(missing)}")

    def append(self, key: str, points: Sequence[Point]) -> bool:
        """Add new points to a run that this tracker has shown; return whether that was possible.
        If not, `show` is needed."""
        from mlflow.exceptions import MlflowException

        run = self._runs.pop(key, None)
        if run is None or run.contradicts(points):
            return False
        try:
            run.add(points)
        except MlflowException as error:
            if not _rejected(error):
                raise
            return False  # the run was deleted in the UI
        self._runs[key] = run
        return True

    def forget(self) -> None:
        """Compare all runs with MLflow again: it was unreachable and may have lost data."""
        self._runs.clear()

    def _open(self, view: RunView) -> MLflowRun:
        found = self._client.search_runs(
            [self.experiment_id],
            f"tags.`{KEY}` = '{view.key}'",
            order_by=["attributes.start_time ASC", "attributes.run_id ASC"],
        )
        for twin in found[1:]:  # created twice, because the first request timed out
            self._client.delete_run(twin.info.run_id)
        run = self._read(found[0] if found else self._create(view), view)
        if run.contradicts(view.points):
            self._client.delete_run(run.id)
            run = self._read(self._create(view), view)
        return run

    def _read(self, run: Any, view: RunView) -> MLflowRun:
        return MLflowRun.read(self._client, run, view.points, self._thorough)

    def _create(self, view: RunView) -> Any:
        tags = {KEY: view.key, **_authorship(view.identity), **view.tags, NOTE: view.note}
        if view.parent is not None:
            parent = self._run_id(view.parent)
            if parent is None:
                raise Incomplete(f"{view.name}: MLflow lacks its parent run")
            tags["mlflow.parentRunId"] = parent
        began = int(view.lifetime.began * 1000)
        return self._client.create_run(self.experiment_id, began, tags, run_name=view.name)

    def _run_id(self, key: str) -> str | None:
        if key in self._runs:
            return self._runs[key].id
        found = self._client.search_runs([self.experiment_id], f"tags.`{KEY}` = '{key}'")
        return str(found[0].info.run_id) if found else None


def _rejected(error: Any) -> bool:
    """Whether MLflow answers but does not accept a value or a run. Other errors are temporary."""
    return error.error_code in ("INVALID_PARAMETER_VALUE", "RESOURCE_DOES_NOT_EXIST")


def _authorship(identity: RunIdentity | None) -> dict[str, str]:
    """Tags from which MLflow takes a run's user and source."""
    if identity is None or identity.author is None:
        return {}
    author = identity.author
    tags = {
        "mlflow.user": author.user,
        "mlflow.source.name": author.command,
        "mlflow.source.type": "LOCAL",
        "mlflow.source.git.commit": author.commit,
    }
    return {name: value for name, value in tags.items() if value}

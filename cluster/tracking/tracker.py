"""Writes views to MLflow: one experiment per task, one run per run folder, and a nested run per
configuration of a study. A tag holds the run's key.

    show(view):
        run <- the run with the view's key, created if missing
        for each of params, tags, points, status, documents, model:
            write the part that the run lacks

Repeating a write changes nothing. A point carries the time of its event, and MLflow's database
keeps one row per metric, step, time and value.
"""

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bilevel.errors import InvalidInput, first_line
from cluster.storage.author import without_password
from cluster.storage.home import Home
from cluster.tracking.connection import connected
from cluster.tracking.registry import register_se
from cluster.tracking.view import Document, Point, RunView

#: Tags with the run's key, and with the versions of its documents as JSON.
KEY, _DOCUMENTS = "bilevel.key", "bilevel.documents"
#: MLflow's documented tag for the description of a run.
_NOTE = "mlflow.note.content"
_WORKFLOW = "workflowType=machine_learning"
#: Page of all experiments. Without the workflow type, the UI opens its pages for language models.
HOME_PAGE = f"/#/experiments?{_WORKFLOW}"


def runs_page(experiment_id: str, run_id: str | None = None) -> str:
    """Path of the UI's page of a run, or of all runs of an experiment."""
    run = "" if run_id is None else f"/{run_id}"
    return f"/#/experiments/{experiment_id}/runs{run}?{_WORKFLOW}"


@dataclass
class _Run:
    """The points and documents of a run in MLflow."""

    id: str
    points: set[tuple[str, int, int]]  # see `Point.key`
    documents: dict[str, str]  # versions by path


class Tracker:
    """Writes the runs of one task to an MLflow server or database. Several threads may share it.

    Artifacts are files in `home` if `uri` is a database, which stores no files. Raises InvalidInput
    if MLflow cannot be reached.
    """

    def __init__(self, uri: str, task_id: str, home: Home) -> None:
        self.uri, self.home = uri, home
        self._runs: dict[str, _Run] = {}
        self._served = uri.startswith("http")
        location = None if self._served else (home.artifacts / task_id).as_uri()
        with connected(uri) as self._client:
            self.experiment_id = _experiment(self._client, task_id, location)

    def address(self, key: str | None = None) -> str:
        """Address of the run with that key, or of all runs of the task; for the home's database
        with the command that serves it."""
        run_id = None
        if key is not None:
            with suppress(Exception):  # MLflow is unreachable
                run_id = self._run_id(key)
        page, uri = runs_page(self.experiment_id, run_id), without_password(self.uri)
        if self._served:
            return uri.rstrip("/") + page
        if self.uri != self.home.database_uri:
            return f"{uri}, experiment {self.experiment_id}"
        return f"http://127.0.0.1:5000{page} (after {self.home.hint('ui')})"

    def show(self, view: RunView) -> None:
        """Write the parts of the view that MLflow lacks.

        Raises InvalidInput if MLflow rejects the run or a document cannot be created, and MLflow's
        exceptions if it is unreachable. Repeating the call completes the run.
        """
        from mlflow.exceptions import MlflowException

        try:
            run = self._runs.pop(view.key, None) or self._open(view)
            self._write_values(run, view)
            self._runs[view.key] = run
            self._write_documents(run, view)
        except MlflowException as error:
            if error.error_code not in ("INVALID_PARAMETER_VALUE", "RESOURCE_DOES_NOT_EXIST"):
                raise  # MLflow is unreachable
            reason = without_password(first_line(error))
            raise InvalidInput(f"{view.name}: MLflow rejects the run ({reason})") from None

    def append(self, key: str, points: Sequence[Point]) -> bool:
        """Add new points to a run that this tracker has shown. Return False if `show` is needed.
        Raises MLflow's exceptions."""
        run = self._runs.get(key)
        if run is not None:
            self._add(run, points)
        return run is not None

    def forget(self) -> None:
        """Compare all runs with MLflow again: it was unreachable and may have lost data."""
        self._runs.clear()

    def _open(self, view: RunView) -> _Run:
        """Find the run with the view's key, or create it."""
        client = self._client
        found = client.search_runs(
            [self.experiment_id],
            f"tags.`{KEY}` = '{view.key}'",
            order_by=["attributes.start_time ASC", "attributes.run_id ASC"],
        )
        for twin in found[1:]:  # created twice, because the first request timed out
            client.delete_run(twin.info.run_id)
        run = found[0] if found else self._create(view)
        points = {
            (name, metric.step, metric.timestamp)
            for name in {point.key[0] for point in view.points} & set(run.data.metrics)
            for metric in client.get_metric_history(run.info.run_id, name)
        }
        return _Run(run.info.run_id, points, json.loads(run.data.tags.get(_DOCUMENTS, "{}")))

    def _create(self, view: RunView) -> Any:
        tags = {KEY: view.key}
        if view.identity is not None and view.identity.author is not None:
            author = view.identity.author
            tags |= {
                "mlflow.user": author.user,
                "mlflow.source.name": author.command,
                "mlflow.source.type": "LOCAL",
                "mlflow.source.git.commit": author.commit,
            }
        if view.parent is not None and (parent := self._run_id(view.parent)):
            tags["mlflow.parentRunId"] = parent
        began = int(view.lifetime.began * 1000)
        return self._client.create_run(self.experiment_id, began, tags, run_name=view.name)

    def _run_id(self, key: str) -> str | None:
        run = self._runs.get(key)  # the mirror's thread may remove it
        if run is not None:
            return run.id
        found = self._client.search_runs([self.experiment_id], f"tags.`{KEY}` = '{key}'")
        return str(found[0].info.run_id) if found else None

    def _write_values(self, run: _Run, view: RunView) -> None:
        from mlflow.entities import Param, RunTag

        self._client.log_batch(
            run.id,
            params=[Param(name, str(value)) for name, value in _flatten(view.params)],
            tags=[RunTag(*tag) for tag in {**view.tags, _NOTE: view.note}.items()],
        )
        self._add(run, view.points)
        status, ended = view.lifetime.status, view.lifetime.ended
        if ended is None:
            self._client.update_run(run.id, status=status)
        else:
            self._client.set_terminated(run.id, status, int(ended * 1000))

    def _add(self, run: _Run, points: Sequence[Point]) -> None:
        """Write the points that the run lacks."""
        from mlflow.entities import Metric

        missing = [point for point in points if point.key not in run.points]
        metrics = [
            Metric(name, float(value), int(point.time * 1000), point.step)
            for point in missing
            for name, value in point.values.items()
        ]
        self._client.log_batch(run.id, metrics=metrics)  # in several requests if necessary
        run.points.update(point.key for point in missing)

    def _write_documents(self, run: _Run, view: RunView) -> None:
        """Upload the documents and the model that the run lacks, or has in another version."""
        before, se = dict(run.documents), view.model
        for document in view.documents:
            if run.documents.get(document.path) != document.version:
                self._upload(run.id, document, view.name)
                run.documents[document.path] = document.version
        if se is not None and run.documents.get("model") != se.file.version:
            register_se(self._client, run.id, se)
            run.documents["model"] = se.file.version
        if run.documents != before:
            self._client.set_tag(run.id, _DOCUMENTS, json.dumps(run.documents))

    def _upload(self, run_id: str, document: Document, name: str) -> None:
        try:
            content = document.content()
        except Exception as error:  # a picture or a file, not MLflow
            raise InvalidInput(f"{name}: no {document.path} ({first_line(error)})") from None
        parent, _, file = document.path.rpartition("/")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / file
            path.write_bytes(content)
            self._client.log_artifact(run_id, str(path), parent or None)


def _experiment(client: Any, task_id: str, location: str | None) -> str:
    """Return the ID of a task's experiment, and create it if missing.

    `location` is the folder of its artifacts; None leaves the choice to the server. Raises
    InvalidInput if the experiment was deleted in the UI.
    """
    from mlflow.exceptions import MlflowException

    found = client.get_experiment_by_name(task_id)
    if found is None:
        with suppress(MlflowException):  # another client may have created it
            return str(client.create_experiment(task_id, location))
        found = client.get_experiment_by_name(task_id)
    if found is None or found.lifecycle_stage == "deleted":
        raise InvalidInput(
            f"MLflow's experiment {task_id!r} was deleted; restore it with "
            "`mlflow experiments restore` (MLFLOW_TRACKING_URI must be set)"
        )
    return str(found.experiment_id)


def _flatten(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Flatten nested dictionaries and join their keys by dots."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value

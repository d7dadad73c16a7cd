"""Writes views to MLflow: whatever a run in MLflow lacks of its view is added.

There is one experiment per task, one run per study, and one child run per configuration (nested by
the tag `mlflow.parentRunId`). A run is found again by its key, a tag.

    show(view):
        run <- the run with the view's key, created if missing or of another edition
        for each of params, points, documents, model, tags, status:
            write what the run lacks

Every write may be repeated: a point carries the time of its event, and the database
holds one row for a metric, time, step and value.
"""

import copy
import json
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from bilevel.errors import InvalidInput, first_line
from cluster.storage.run_folder import RunIdentity
from cluster.tracking.connection import connected
from cluster.tracking.experiment import NOTE, Experiment, runs_page
from cluster.tracking.registry import register_se
from cluster.tracking.view import Document, DocumentFailed, Point, RunView

#: Tags with the run's key, the versions of its documents, as JSON, and its edition. The UI shows no
#: tags that begin like this.
KEY = "mlflow.bilevel.key"
_DOCUMENTS, _EDITION = "mlflow.bilevel.documents", "mlflow.bilevel.edition"
_PARENT = "mlflow.parentRunId"
#: Metrics after which a request is sent. MLflow takes 1000 and would divide more, so that a point
#: could be torn.
_BATCH = 900


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested dictionaries; keys are joined by dots."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = value
    return flat


@dataclass
class _Shown:
    """Content of a run in MLflow."""

    run_id: str
    status: str
    params: set[str]
    tags: dict[str, str]
    marks: set[tuple[str, int, int]]  # points, as `Point.mark`
    documents: dict[str, str]  # versions by path


class Tracker:
    """Writes the runs of one task to one MLflow server or database.

    `artifacts` is the folder of artifacts if `uri` is a database, which stores no files. A
    `thorough` tracker writes every document again instead of trusting the run's tags. Raises
    InvalidInput if MLflow cannot be reached.
    """

    def __init__(self, uri: str, task_id: str, artifacts: Path, thorough: bool = False) -> None:
        self.uri = uri
        self._thorough = thorough
        self._shown: dict[str, _Shown] = {}
        location = (artifacts / task_id).resolve().as_uri() if self.server is None else None
        with connected(uri) as self._client:
            self._experiment = Experiment(self._client, task_id, location)

    def another(self) -> Self:
        """A tracker of the same task and MLflow, which may be away by now, for another thread."""
        other = copy.copy(self)
        other._shown = {}
        return other

    @property
    def experiment_id(self) -> str:
        """MLflow's id of the task's experiment."""
        return self._experiment.id

    @property
    def server(self) -> str | None:
        """Address of the MLflow server; None for a database."""
        return self.uri.rstrip("/") if self.uri.startswith("http") else None

    def page(self, key: str | None = None) -> str:
        """Path of the UI's page of the run with that key, or of all runs of the task; the rest of
        the address depends on who serves the UI."""
        run_id = None
        if key is not None:
            with suppress(Exception):  # MLflow is away, or lacks the run: then its list of runs
                run_id = self._run_id(key)
        return runs_page(self.experiment_id, run_id)

    def show(self, view: RunView) -> None:
        """Write to MLflow what it lacks of the view.

        Raises MLflow's exceptions; part of the view may then be written, and repeating the call
        completes it. Raises DocumentFailed, after all else is written, for a document that cannot
        be made.
        """
        shown = self._shown.pop(view.key, None) or self._open(view)
        if view.edition is not None:
            if not view.edition.startswith(shown.tags.get(_EDITION, "")):
                self._client.delete_run(shown.run_id)
                shown = self._open(view)
            self._show_tags(shown, {_EDITION: view.edition})
        self._show_params(shown, view.params)
        self._show_points(shown, view.points)
        failed: list[DocumentFailed] = []
        for document in view.documents:
            try:
                self._show_document(shown, document)
            except DocumentFailed as error:
                failed.append(error)
        if view.model is not None and shown.documents.get("model") != view.model.version:
            try:
                register_se(self._client, shown.run_id, view.model)
                self._note_document(shown, "model", view.model.version)
            except InvalidInput as error:  # its file is damaged
                failed.append(DocumentFailed(f"its SE as a model ({error})"))
        self._show_tags(shown, {**view.tags, NOTE: view.note})
        self._show_status(shown, view)
        if view.parent is not None:
            self._experiment.show_columns(view.params)
        self._shown[view.key] = shown  # after a failed write, the run is read again
        if failed:
            raise failed[0]

    def forget(self) -> None:
        """Read all runs again: MLflow was unreachable and may have lost data."""
        self._shown.clear()
        self._experiment.forget()

    def _open(self, view: RunView) -> _Shown:
        runs = self._client.search_runs(
            [self.experiment_id],
            f"tags.`{KEY}` = '{view.key}'",
            order_by=["attributes.start_time ASC", "attributes.run_id ASC"],
        )
        for twin in runs[1:]:  # two requests created the run: the first timed out
            self._client.delete_run(twin.info.run_id)
        if not runs:
            tags = {KEY: view.key, **_authorship(view.identity), **view.tags, NOTE: view.note}
            if view.parent is not None:
                tags[_PARENT] = self._run_id(view.parent)
            runs = [
                self._client.create_run(
                    self.experiment_id, _milliseconds(view.lifetime.began), tags, run_name=view.name
                )
            ]
        run = runs[0]
        run_id = str(run.info.run_id)
        tags = dict(run.data.tags)
        known = {} if self._thorough else json.loads(tags.get(_DOCUMENTS, "{}"))
        marks = {
            (name, metric.step, time)
            for name in {point.mark[0] for point in view.points} & set(run.data.metrics)
            for metric in self._client.get_metric_history(run_id, name)
            for time in (0, metric.timestamp)
        }
        return _Shown(run_id, run.info.status, set(run.data.params), tags, marks, known)

    def _run_id(self, key: str) -> str:
        if key in self._shown:
            return self._shown[key].run_id
        runs = self._client.search_runs([self.experiment_id], f"tags.`{KEY}` = '{key}'")
        if not runs:
            raise LookupError(f"the run {key} is not there yet")
        return str(runs[0].info.run_id)

    def _show_params(self, shown: _Shown, params: Mapping[str, Any]) -> None:
        from mlflow.entities import Param

        missing = {k: v for k, v in flatten(params).items() if k not in shown.params}
        if missing:
            entries = [Param(name, str(value)) for name, value in missing.items()]
            self._client.log_batch(shown.run_id, params=entries)
            shown.params |= set(missing)

    def _show_points(self, shown: _Shown, points: tuple[Point, ...]) -> None:
        from mlflow.entities import Metric

        missing = [point for point in points if point.mark not in shown.marks]
        batch: list[Any] = []
        for i, point in enumerate(missing):
            batch += [
                Metric(name, float(value), point.milliseconds, point.step)
                for name, value in point.values.items()
            ]
            if len(batch) > _BATCH or i == len(missing) - 1:
                self._client.log_batch(shown.run_id, metrics=batch)
                batch = []
        shown.marks |= {point.mark for point in missing}

    def _show_tags(self, shown: _Shown, tags: Mapping[str, str]) -> None:
        for name, value in tags.items():
            if shown.tags.get(name) != value:
                self._client.set_tag(shown.run_id, name, value)
                shown.tags[name] = value

    def _show_document(self, shown: _Shown, document: Document) -> None:
        if shown.documents.get(document.path) == document.version:
            return
        try:
            content = document.content()
        except Exception as error:  # of what draws or reads it, not of MLflow
            raise DocumentFailed(f"{document.path} ({first_line(error)})") from error
        parent, _, name = document.path.rpartition("/")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            path.write_bytes(content)
            self._client.log_artifact(shown.run_id, str(path), parent or None)
        self._note_document(shown, document.path, document.version)

    def _note_document(self, shown: _Shown, path: str, version: str) -> None:
        shown.documents[path] = version
        self._client.set_tag(shown.run_id, _DOCUMENTS, json.dumps(shown.documents))

    def _show_status(self, shown: _Shown, view: RunView) -> None:
        status, ended = view.lifetime.status, view.lifetime.ended
        if status == shown.status:
            return
        if ended is None:
            self._client.update_run(shown.run_id, status=status)
        else:
            self._client.set_terminated(shown.run_id, status, _milliseconds(ended))
        shown.status = status


def _authorship(identity: RunIdentity | None) -> dict[str, str]:
    """Tags that MLflow shows as the run's user and source."""
    if identity is None or identity.author is None:
        return {}
    author = identity.author
    tags = {
        "mlflow.user": author.user,
        "mlflow.source.name": author.program,
        "mlflow.source.type": "LOCAL",
        "mlflow.source.git.commit": author.commit,
    }
    return {name: value for name, value in tags.items() if value}


def _milliseconds(seconds: float) -> int:
    return int(seconds * 1000)

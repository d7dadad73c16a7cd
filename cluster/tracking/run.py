"""One run in MLflow, and the writes that complete it.

Repeating a write changes nothing. A point carries the time of its event, and MLflow's database
keeps one row per metric, step, time and value.
"""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from bilevel.errors import InvalidInput, first_line
from cluster.tracking.experiment import NOTE
from cluster.tracking.registry import register_se
from cluster.tracking.view import Document, Point, RunView

#: Tag with the versions of the run's documents, as JSON.
_DOCUMENTS = "bilevel.documents"
#: Points per request: a generation has about 20 metrics, and MLflow accepts 1000.
_BATCH = 40


@dataclass
class MLflowRun:
    """The points and documents of a run in MLflow; each write adds to them."""

    client: Any
    id: str
    documents: dict[str, str]  # versions by path
    times: dict[tuple[str, int], set[int]]  # milliseconds by position of a point

    @classmethod
    def read(cls, client: Any, run: Any, points: Sequence[Point], thorough: bool) -> Self:
        """Read a run, with the history of the metrics of `points`. If `thorough`, all its documents
        count as missing."""
        times: dict[tuple[str, int], set[int]] = {}
        for name in {point.position[0] for point in points} & set(run.data.metrics):
            for metric in client.get_metric_history(run.info.run_id, name):
                times.setdefault((name, metric.step), set()).add(metric.timestamp)
        documents = {} if thorough else json.loads(run.data.tags.get(_DOCUMENTS, "{}"))
        return cls(client, run.info.run_id, documents, times)

    def contradicts(self, points: Sequence[Point]) -> bool:
        """Whether generations were repeated after a damaged checkpoint: the scores are the same,
        the measured times are not."""
        return any(p.unique and p.position in self.times and self._lacks(p) for p in points)

    def complete(self, view: RunView) -> list[str]:
        """Write a view; return a line for each part that cannot be created. Raises MLflow's
        exceptions."""
        from mlflow.entities import Param, RunTag

        failed = self._add_documents(view)
        tags = {**view.tags, NOTE: view.note, _DOCUMENTS: json.dumps(self.documents)}
        self.client.log_batch(
            self.id,
            params=[Param(name, str(value)) for name, value in flatten(view.params).items()],
            tags=[RunTag(name, value) for name, value in tags.items()],
        )
        self.add(view.points)
        status, ended = view.lifetime.status, view.lifetime.ended
        if ended is None:
            self.client.update_run(self.id, status=status)
        else:
            self.client.set_terminated(self.id, status, int(ended * 1000))
        return failed

    def add(self, points: Sequence[Point]) -> None:
        """Write the points that the run lacks. Raises MLflow's exceptions."""
        from mlflow.entities import Metric

        missing = [point for point in points if self._lacks(point)]
        for first in range(0, len(missing), _BATCH):
            batch = missing[first : first + _BATCH]
            metrics = [
                Metric(name, float(value), point.milliseconds, point.step)
                for point in batch
                for name, value in point.values.items()
            ]
            self.client.log_batch(self.id, metrics=metrics)
            for point in batch:
                self.times.setdefault(point.position, set()).add(point.milliseconds)

    def _lacks(self, point: Point) -> bool:
        return point.milliseconds not in self.times.get(point.position, ())

    def _add_documents(self, view: RunView) -> list[str]:
        failed = []
        for document in view.documents:
            if self.documents.get(document.path) == document.version:
                continue
            try:
                content = document.content()
            except Exception as error:  # a picture or a file, not MLflow
                failed.append(f"{document.path} ({first_line(error)})")
            else:
                self._upload(document, content)
        if view.model is not None and self.documents.get("model") != view.model.version:
            try:
                register_se(self.client, self.id, view.model)
                self.documents["model"] = view.model.version
            except InvalidInput as error:  # a damaged file
                failed.append(f"its SE as a model ({error})")
        return failed

    def _upload(self, document: Document, content: bytes) -> None:
        parent, _, name = document.path.rpartition("/")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            path.write_bytes(content)
            self.client.log_artifact(self.id, str(path), parent or None)
        self.documents[document.path] = document.version


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested dictionaries and join their keys by dots."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = value
    return flat

"""MLflow as this package uses it: experiments, runs, generations, the registry.

One experiment a task; one run a study, one child run a configuration (nested by the
tag `mlflow.parentRunId`). A run is found again by its tag `bilevel.key`, so a
continued study goes on in the same runs, and a generation that is already there is
not logged twice.
"""

import json
import logging
import socket
import threading
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

from bilevel.errors import InvalidInput
from bilevel.nes import GenerationRecord

_KEY = "bilevel.key"
#: Makes the UI open the experiment on its runs instead of on a page for chat traces.
_KIND = "mlflow.experimentKind"
_CONNECT_TIMEOUT = 5.0  # seconds until a server counts as unreachable

Params = Mapping[str, Any]


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested dictionaries as one, keys joined by dots."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = value
    return flat


def check_tracking_uri(uri: str) -> None:
    """Raise InvalidInput if `uri` is of no known kind, or nobody answers there."""
    parts = urlparse(uri)
    if parts.scheme in ("http", "https"):
        try:
            port = parts.port or (443 if parts.scheme == "https" else 80)
            socket.create_connection((parts.hostname or "", port), _CONNECT_TIMEOUT).close()
        except (OSError, ValueError) as error:
            raise InvalidInput(f"no MLflow server at {uri!r}: {error}") from None
    elif parts.scheme not in ("sqlite", "postgresql", "mysql", "mssql"):
        raise InvalidInput(
            f"tracking URI {uri!r} is not valid: allowed are http(s)://host:port, "
            "sqlite:///path and other database URIs"
        )


@contextmanager
def mlflow_imported_meanwhile() -> Iterator[None]:
    """Within the block, MLflow is being imported in a thread: it takes seconds, which
    whoever waits for the processes of a Ray cluster has to spare."""
    thread = threading.Thread(target=_import_mlflow, name="import mlflow")
    thread.start()
    try:
        yield
    finally:
        thread.join()  # an import must not be caught by the end of the process


def _import_mlflow() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import mlflow
        import mlflow.store.tracking.sqlalchemy_store  # noqa: F401


class Tracker:
    """Writes the runs of one task to one MLflow server or database.

    `artifacts` is where a database (which stores no files) puts artifacts. Raises
    InvalidInput if MLflow cannot be reached.
    """

    def __init__(self, uri: str, experiment: str, artifacts: Path) -> None:
        check_tracking_uri(uri)
        for name in ("alembic", "mlflow.store.db.utils", "mlflow.tracking"):
            logging.getLogger(name).setLevel(logging.ERROR)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import mlflow
            from mlflow.exceptions import MlflowException
            from sqlalchemy.exc import SQLAlchemyError

        self.uri = uri
        location = None if uri.startswith("http") else (artifacts / experiment).resolve().as_uri()
        try:
            self._client = mlflow.MlflowClient(uri, registry_uri=uri)
            found = self._client.get_experiment_by_name(experiment)
            self.experiment_id = (
                found.experiment_id
                if found is not None
                else self._client.create_experiment(
                    experiment, artifact_location=location, tags={_KIND: "custom_model_development"}
                )
            )
        except (MlflowException, SQLAlchemyError, OSError) as error:
            reason = str(error).strip().splitlines()[0]
            raise InvalidInput(f"MLflow at {uri!r} cannot be used: {reason}") from None
        self._logged_until: dict[str, int] = {}  # run -> last generation logged

    @property
    def address(self) -> str:
        """Where a person looks at the runs."""
        if self.uri.startswith("http"):
            return f"{self.uri.rstrip('/')}/#/experiments/{self.experiment_id}/runs"
        return f"`make ui`, experiment {self.experiment_id}"

    def open_run(
        self,
        key: str,
        name: str,
        params: Params,
        tags: Mapping[str, str],
        parent: str | None = None,
        description: str = "",
    ) -> str:
        """The id of the run with that key: reopened if it exists, else created."""
        found = self._client.search_runs(
            [self.experiment_id], f"tags.`{_KEY}` = '{key}'", max_results=1
        )
        if found:
            run_id = str(found[0].info.run_id)
            self._client.update_run(run_id, status="RUNNING")
            history = self._client.get_metric_history(run_id, "score_mean")
            self._logged_until[run_id] = max((metric.step for metric in history), default=-1)
            return run_id
        all_tags = {_KEY: key, **tags}
        if parent is not None:
            all_tags["mlflow.parentRunId"] = parent
        if description:
            all_tags["mlflow.note.content"] = description
        run = self._client.create_run(self.experiment_id, tags=all_tags, run_name=name)
        run_id = str(run.info.run_id)
        from mlflow.entities import Param

        entries = [Param(k, str(v)) for k, v in flatten(params).items()]
        self._client.log_batch(run_id, params=entries)
        self._logged_until[run_id] = -1
        return run_id

    def log_generations(self, run_id: str, records: Iterable[GenerationRecord]) -> None:
        """Log the generations that are not there yet, each at its own step."""
        for record in records:
            if record.generation > self._logged_until[run_id]:
                values = asdict(record)
                self.log_metrics(run_id, values, values.pop("generation"))
                self._logged_until[run_id] = record.generation

    def log_metrics(self, run_id: str, values: Mapping[str, float], step: int) -> None:
        """Log several metrics at one step."""
        import time

        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        metrics = [Metric(name, float(value), now, step) for name, value in values.items()]
        self._client.log_batch(run_id, metrics=metrics)

    def log_file(self, run_id: str, path: Path, folder: str | None = None) -> None:
        """Store a file as artifact, replacing one of the same name."""
        self._client.log_artifact(run_id, str(path), folder)

    def log_text(self, run_id: str, text: str, name: str) -> None:
        """Store a text as artifact."""
        self._client.log_text(run_id, text, name)

    def log_json(self, run_id: str, values: Params, name: str) -> None:
        """Store a dictionary as JSON artifact."""
        self._client.log_text(run_id, json.dumps(values, indent=2), name)

    def log_figure(self, run_id: str, figure: Any, name: str) -> None:
        """Store a matplotlib figure as artifact."""
        self._client.log_figure(run_id, figure, name)

    def set_tags(self, run_id: str, tags: Mapping[str, str]) -> None:
        """Set tags."""
        for name, value in tags.items():
            self._client.set_tag(run_id, name, value)

    def close_run(self, run_id: str, status: str = "FINISHED") -> None:
        """Mark a run FINISHED, FAILED or KILLED."""
        self._client.set_terminated(run_id, status)

    def register_se(self, run_id: str, path: Path, task_id: str, tags: Mapping[str, str]) -> str:
        """Register an SE file as the task's newest model version, under the alias
        `best`; returns the model's address (`models:/name@best`).

        `mlflow.pyfunc.load_model` of it gives an object whose `predict` runs the SE.
        """
        import tempfile

        import mlflow.pyfunc
        from mlflow.exceptions import MlflowException

        name = f"SE-{task_id}"
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = Path(folder) / "model"
            mlflow.pyfunc.save_model(
                model,
                loader_module="cluster.tracking.se_model",
                data_path=str(path),
                pip_requirements=["bilevel"],
            )
            self._client.log_artifacts(run_id, str(model), "model")
        try:
            self._client.create_registered_model(
                name, description=f"Synthetic environments for {task_id}."
            )
        except MlflowException as error:
            if error.error_code != "RESOURCE_ALREADY_EXISTS":
                raise
        source = f"{self._client.get_run(run_id).info.artifact_uri}/model"
        version = self._client.create_model_version(
            name, source, run_id, tags={key: str(value) for key, value in tags.items()}
        )
        self._client.set_registered_model_alias(name, "best", version.version)
        return f"models:/{name}@best"

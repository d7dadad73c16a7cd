"""Comparison of MLflow with the disk, and an MLflow server that tests may kill."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import mlflow
import psutil

from cluster.catalog import views_of
from cluster.storage.home import Home
from cluster.storage.run_folder import RunIdentity
from cluster.tracking import RunView
from cluster.tracking.tracker import KEY
from tests.commands import free_port, listening
from tests.ends import kill_family
from tests.faults.outcome import TIMES


def disagreements(folder: Path, tracking_uri: str) -> list[str]:
    """Differences between MLflow and the disk: runs that are missing, duplicated or left running,
    points that are missing or additional, and missing files. Generations that were repeated after a
    damaged checkpoint may have several measured times."""
    client = mlflow.MlflowClient(tracking_uri, registry_uri=tracking_uri)
    experiment = client.get_experiment_by_name(folder.parent.name)
    if experiment is None:
        return ["no experiment"]
    views, found = views_of(folder), []
    keys = views.keys()
    for key in keys:
        view = views.view(key)
        runs = client.search_runs([experiment.experiment_id], f"tags.`{KEY}` = '{key}'")
        if len(runs) == 1:
            found += _of_run(client, runs[0], view)
        else:
            found.append(f"{view.name}: {len(runs)} runs")
    uuid = RunIdentity.read(folder).uuid
    runs = client.search_runs([experiment.experiment_id], f"tags.`{KEY}` LIKE '{uuid}%'")
    if len(runs) > len(keys):
        found.append(f"{len(runs)} runs instead of {len(keys)}")
    return found


def _of_run(client: mlflow.MlflowClient, run: mlflow.entities.Run, view: RunView) -> list[str]:
    found = []
    if run.info.status != view.lifetime.status or view.lifetime.status == "RUNNING":
        found.append(f"{view.name}: {run.info.status} instead of {view.lifetime.status}")
    expected: dict[str, set[tuple[int, float]]] = {}
    for point in view.points:
        for name, value in point.values.items():
            expected.setdefault(name, set()).add((point.step, float(value)))
    if set(run.data.metrics) != set(expected):
        found.append(f"{view.name}: other metrics")
    for name, series in expected.items():
        history = client.get_metric_history(run.info.run_id, name)
        points = {(metric.step, metric.value) for metric in history}
        if not (series <= points if name in TIMES else series == points):
            found.append(f"{view.name}: {name} has steps {[metric.step for metric in history]}")
    stored = {file.path for file in client.list_artifacts(run.info.run_id)}
    missing = {document.path.split("/")[0] for document in view.documents} - stored
    if missing:
        found.append(f"{view.name}: lacks {sorted(missing)}")
    return found


class Server:
    """An MLflow server with its own home; a context manager that stops it.

    `empty` is a file of MLflow's database without runs, which saves the seconds of creating one.
    With a `backend`, the server uses that database, and artifacts pass through the server, as in
    docs/cluster.md.
    """

    def __init__(self, folder: Path, backend: str | None = None, empty: Path | None = None) -> None:
        self._home = Home(folder)
        self._home.prepare()
        if empty is not None:
            shutil.copy(empty, folder)
        self._port = free_port()
        self._options = ["--backend-store-uri", backend or self._home.database_uri]
        artifacts = "--artifacts-destination" if backend else "--default-artifact-root"
        self._options += [artifacts, self._home.artifacts.as_uri()]
        self._process: psutil.Popen | None = None

    @property
    def uri(self) -> str:
        """The server's URI."""
        return f"http://127.0.0.1:{self._port}"

    def start(self) -> None:
        """Start the server and return when it answers."""
        command = [sys.executable, "-m", "mlflow", "server", "--port", str(self._port)]
        quiet = {"MLFLOW_LOGGING_LEVEL": "ERROR", "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
        with (self._home.folder / "server.log").open("a") as log:
            self._process = psutil.Popen(
                [*command, "--workers", "1", *self._options],
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **quiet},
                start_new_session=True,
            )
        deadline = time.monotonic() + 90
        while not listening("127.0.0.1", self._port):
            if time.monotonic() > deadline:
                raise TimeoutError("the MLflow server does not start")
            time.sleep(0.1)

    def kill(self) -> None:
        """Kill the server (SIGKILL)."""
        if self._process is not None:
            kill_family(self._process)
            self._process = None

    def __enter__(self) -> "Server":
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.kill()

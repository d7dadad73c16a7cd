"""Comparison of MLflow with the disk, and an MLflow server that may be killed."""

import os
import shutil
import subprocess
import time
from pathlib import Path

import mlflow
import psutil

from cluster.catalog.kinds import views_of
from cluster.cli.ui import mlflow_server
from cluster.storage.home import Home
from cluster.storage.run_folder import RunIdentity
from cluster.tracking import RunView
from cluster.tracking.tracker import KEY
from tests.commands import free_port, listening
from tests.ends import kill_family


def disagreements(folder: Path, tracking_uri: str) -> list[str]:
    """Differences between MLflow and the disk: a run that is missing, duplicated or left running, a
    point that is missing, added or duplicated, a missing file."""
    client = mlflow.MlflowClient(tracking_uri, registry_uri=tracking_uri)
    experiment = client.get_experiment_by_name(folder.parent.name)
    if experiment is None:
        return ["no experiment"]
    views, found = views_of(folder), []
    identity = RunIdentity.read(folder).uuid
    keys = views.keys()
    for key in keys:
        view = views.view(key)
        runs = client.search_runs([experiment.experiment_id], f"tags.`{KEY}` = '{key}'")
        if len(runs) != 1:
            found.append(f"{view.name}: {len(runs)} runs")
        else:
            found += _of_run(client, runs[0], view)
    runs = client.search_runs([experiment.experiment_id], f"tags.`{KEY}` LIKE '{identity}%'")
    if len(runs) > len(keys):
        found.append(f"{len(runs)} runs instead of {len(keys)}")
    return found


def _of_run(client: mlflow.MlflowClient, run: mlflow.entities.Run, view: RunView) -> list[str]:
    found = []
    if run.info.status != view.lifetime.status or view.lifetime.status == "RUNNING":
        found.append(f"{view.name}: {run.info.status} instead of {view.lifetime.status}")
    expected: dict[str, list[tuple[int, float]]] = {}
    for point in view.points:
        for name, value in point.values.items():
            expected.setdefault(name, []).append((point.step, float(value)))
    if set(run.data.metrics) != set(expected):
        found.append(f"{view.name}: other metrics")
    for name, series in expected.items():
        history = client.get_metric_history(run.info.run_id, name)
        if sorted((m.step, m.value) for m in history) != sorted(series):
            found.append(f"{view.name}: {name} has steps {[m.step for m in history]}")
    stored = {file.path for file in client.list_artifacts(run.info.run_id)}
    lacking = {document.path.split("/")[0] for document in view.documents} - stored
    if lacking:
        found.append(f"{view.name}: lacks {sorted(lacking)}")
    return found


class Server:
    """An MLflow server on its own home; a context manager that ends it.

    With a `backend` the server is set up for several nodes, as in docs/cluster.md: on that
    database, with artifacts passing through the server. `empty` is a file of MLflow's database
    without a run, to begin with; making a new one takes seconds.
    """

    def __init__(self, folder: Path, backend: str | None = None, empty: Path | None = None) -> None:
        self._home = Home(folder)
        self._backend = backend
        self._home.prepare()
        if empty is not None:
            shutil.copy(empty, folder)
        self._port = free_port()
        self._process: psutil.Popen | None = None

    @property
    def uri(self) -> str:
        """The server's URI."""
        return f"http://127.0.0.1:{self._port}"

    def start(self) -> None:
        """Start the server; return once it answers."""
        command, environment = mlflow_server(self._home, "127.0.0.1", self._port)
        if self._backend is not None:
            command = [*command[: command.index("--backend-store-uri")]]
            command += ["--backend-store-uri", self._backend]
            command += ["--artifacts-destination", str(self._home.artifacts)]
        with (self._home.folder / "server.log").open("a") as log:
            self._process = psutil.Popen(
                command,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **environment},
                start_new_session=True,
            )
        deadline = time.monotonic() + 90
        while not listening("127.0.0.1", self._port):
            if time.monotonic() > deadline:
                raise TimeoutError("the MLflow server does not come up")
            time.sleep(0.1)

    def kill(self) -> None:
        """Kill the server at once (SIGKILL)."""
        if self._process is not None:
            kill_family(self._process)
            self._process = None

    def __enter__(self) -> "Server":
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.kill()

"""MLflow server on a home, for `bilevel ui` and, in the background, `bilevel up`."""

import os
import subprocess

import psutil

from bilevel.errors import InvalidInput
from cluster.services.family import end_family
from cluster.services.ports import reachable, require_free
from cluster.services.programs import program
from cluster.session.interrupts import InterruptGuard
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from cluster.tracking.database import experiments
from cluster.tracking.experiment import HOME_PAGE, runs_page


def mlflow_server(home: Home, host: str, port: int) -> tuple[list[str], dict[str, str]]:
    """Command and environment of a server on the home's database and artifacts.

    Clients of the server also write artifacts to the locations in the database, so the database
    works with and without the server.
    """
    command = ["mlflow", "server", "--host", host, "--port", str(port), "--workers", "1"]
    command += ["--backend-store-uri", home.database_uri]
    command += ["--registry-store-uri", home.database_uri]
    command += ["--default-artifact-root", home.artifacts.as_uri()]
    command += ["--uvicorn-opts", "--log-level error"]
    # Log errors only, and run no jobs for language models.
    return command, {
        "MLFLOW_LOGGING_LEVEL": "ERROR",
        "PYTHONWARNINGS": "ignore",
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
    }


def pages(home: Home, server: str) -> list[str]:
    """Each task of a home, with the address of its runs on a server. Raises InvalidInput if the
    database is damaged."""
    found = experiments(home.database)
    return [f"{name}: {server}{runs_page(number)}" for number, name in found.items()]


def addresses(home: Home, server: str) -> list[str]:
    """The address of a server's UI, then its `pages`."""
    return [f"MLflow UI: {server}{HOME_PAGE}", *pages(home, server)]


def serve_ui(home: Home, host: str, port: int) -> int:
    """Serve until interrupted; return the server's exit code.

    Raises InvalidInput if there are no runs yet, the database is damaged, or the port is taken.
    """
    database = home.database
    if not database.exists():
        start = home.hint("nes CartPole-v0", "nes-cartpole")
        raise InvalidInput(f"no runs in {str(home.folder)!r} yet: start with {start}")
    found = addresses(home, f"http://{reachable(host)}:{port}")
    require_free(host, port)
    print(*found, sep="\n", flush=True)
    print("Ctrl-C ends the MLflow UI", flush=True)
    command, environment = mlflow_server(home, host, port)
    command[0] = program(command[0])
    # In a session of its own, so that Ctrl-C ends it by this process, without its tracebacks.
    server = subprocess.Popen(command, env={**os.environ, **environment}, start_new_session=True)
    try:
        with InterruptGuard(Terminal()):
            return server.wait()
    except KeyboardInterrupt:
        return 0
    finally:
        if server.poll() is None:
            end_family(psutil.Process(server.pid))

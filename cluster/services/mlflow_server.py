"""MLflow server on a home, for `bilevel ui` and, in the background, `bilevel up`."""

import os
import subprocess
import sys
from pathlib import Path

from bilevel.errors import InvalidInput
from cluster.services.ports import require_free
from cluster.storage.home import Home


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


def serve_ui(home: Home, host: str, port: int) -> int:
    """Serve until interrupted; return the server's exit code.

    Raises InvalidInput if there are no runs yet, or the port is taken.
    """
    if not (home.folder / "mlflow.db").exists():
        raise InvalidInput(f"no runs in {str(home.folder)!r} yet: start with `make nes-cartpole`")
    require_free(host, port)
    address = f"http://{host}:{port}/#/experiments?workflowType=machine_learning"
    print(f"MLflow UI on {address}  (Ctrl-C ends it)", flush=True)
    command, environment = mlflow_server(home, host, port)
    command[0] = str(Path(sys.executable).with_name(command[0]))
    try:
        return subprocess.run(command, env={**os.environ, **environment}, check=False).returncode
    except KeyboardInterrupt:
        return 0

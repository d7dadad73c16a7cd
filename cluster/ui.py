"""`bilevel ui`: MLflow's own server on the runs of a home folder."""

import os
import socket
import subprocess
import sys

from bilevel.errors import InvalidInput
from cluster.home import Home


def serve_ui(home: Home, host: str, port: int) -> int:
    """Serve until interrupted; returns the server's exit code.

    Raises InvalidInput if there are no runs yet, or the port is taken.
    """
    if not (home.folder / "mlflow.db").exists():
        raise InvalidInput(f"no runs in {str(home.folder)!r} yet: begin with `make nes-cartpole`")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InvalidInput(f"cannot serve on {host}:{port}: {error.strerror}") from None
    address = f"http://{host}:{port}/#/experiments?workflowType=machine_learning"
    print(f"MLflow UI on {address}  (Ctrl-C ends it)", flush=True)
    # Only errors are worth a line, and jobs for language models are not wanted.
    environment = {
        **os.environ,
        "MLFLOW_LOGGING_LEVEL": "ERROR",
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
    }
    command = [sys.executable, "-m", "mlflow", "server", "--host", host, "--port", str(port)]
    command += ["--backend-store-uri", home.database_uri, "--workers", "1"]
    command += ["--default-artifact-root", home.artifacts.as_uri()]
    command += ["--uvicorn-opts", "--log-level error"]
    try:
        return subprocess.run(command, env=environment, check=False).returncode
    except KeyboardInterrupt:
        return 0

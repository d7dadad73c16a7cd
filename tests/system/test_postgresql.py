"""An MLflow server on a real PostgreSQL, set up as in docs/cluster.md."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from cluster.catalog import sync
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from tests.commands import free_port
from tests.mlflow_shown import Server, disagreements
from tests.studies import make_study

#: Folder of the server's programs in Debian's package.
_DEBIAN = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
_PATH = os.pathsep.join([os.environ["PATH"], *map(str, _DEBIAN)])

pytestmark = [
    pytest.mark.timeout(180),
    pytest.mark.skipif(
        shutil.which("initdb", path=_PATH) is None, reason="PostgreSQL is not installed"
    ),
]


@pytest.fixture
def postgresql() -> Iterator[str]:
    """Address of an empty database in a new server. PostgreSQL does not run as root, so root starts
    it as another user, who cannot read pytest's temporary folders."""
    with tempfile.TemporaryDirectory(prefix="postgresql-") as name:
        folder, data, port = Path(name), Path(name, "data"), free_port()
        as_user: list[str] = []
        if os.geteuid() == 0:
            as_user = ["setpriv", "--reuid", "nobody", "--regid", "nogroup", "--clear-groups"]
            shutil.chown(folder, "nobody", "nogroup")

        def call(*command: str) -> None:
            program = shutil.which(command[0], path=_PATH)
            assert program is not None
            arguments = [*as_user, program, *command[1:]]
            subprocess.run(arguments, check=True, capture_output=True, cwd=folder)

        call("initdb", "-D", str(data), "-U", "mlflow", "--auth=trust", "--no-sync")
        options = f"-p {port} -k {folder} -c listen_addresses=127.0.0.1 -c fsync=off"
        call("pg_ctl", "-D", str(data), "-l", str(folder / "log"), "-w", "-o", options, "start")
        yield f"postgresql+psycopg2://mlflow@127.0.0.1:{port}/postgres"
        call("pg_ctl", "-D", str(data), "-m", "immediate", "-w", "stop")


def test_a_study_is_tracked_in_postgresql(postgresql: str, tmp_path: Path) -> None:
    pytest.importorskip("psycopg2")
    home = Home(tmp_path)
    home.prepare()
    folder = home.run_folder("CartPole-v0", "made")
    make_study(folder, fail=(1,))
    with Server(tmp_path / "server", postgresql) as server:
        for _ in range(2):  # the second call adds nothing
            sync(folder, home, server.uri, Terminal())
            assert disagreements(folder, server.uri) == []
    assert any((tmp_path / "server" / "artifacts").rglob("best_se.safetensors"))

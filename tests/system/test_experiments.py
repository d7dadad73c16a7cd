"""`bilevel experiment` with real Ray, MLflow and kills."""

import json
import os
import shutil
import signal
from pathlib import Path

import pytest

from cluster.experiments.run import REPORT_FILE, RESULTS_FILE, StoredFindings
from tests.commands import run_bilevel
from tests.system.conftest import client, run_until

pytestmark = pytest.mark.timeout(280)

TRANSFER = ("experiment", "transfer", "CartPole-v0", "--size", "smoke", "--agent", "ddqn")


def agents(home: Path) -> dict[str, list[float]]:
    """Return the stored test returns by key."""
    folder = home / "CartPole-v0" / "experiment-smoke-transfer-ddqn-seed0"
    lines = (folder / RESULTS_FILE).read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    assert len({key for key, _ in rows}) == len(rows)  # no duplicates
    return {key: result["test_returns"] for key, result in rows}


def test_a_killed_experiment_resumes_in_a_copied_home(tmp_home: Path, address: str) -> None:
    """Its results, after a call that adds agents, equal those of one call."""
    cluster = ("--address", address)
    with run_until("generation   0", *TRANSFER, *cluster, "--home", tmp_home) as process:
        os.killpg(process.pid, signal.SIGKILL)
    copy = tmp_home / "copy"
    shutil.copytree(tmp_home / "CartPole-v0", copy / "CartPole-v0")
    shutil.copy(tmp_home / "mlflow.db", copy)
    resume = (*TRANSFER, *cluster, "--home", copy, "--workers", "1")
    first = run_bilevel(*resume, "--agents", "1")
    assert first.returncode == 0, first.stderr
    before = agents(copy)
    more = run_bilevel(*resume)
    assert more.returncode == 0, more.stderr
    assert "generation" not in more.stdout  # the SEs exist
    after = agents(copy)
    assert before.items() < after.items()

    one_call = run_bilevel(*TRANSFER, *cluster, "--home", tmp_home)
    assert one_call.returncode == 0, one_call.stderr
    assert agents(tmp_home) == after

    report = ("experiment", "report", *TRANSFER[2:], "--home", copy)
    written = run_bilevel(*report)
    assert written.returncode == 0, written.stderr
    folder = copy / "CartPole-v0" / "experiment-smoke-report-ddqn-seed0"
    page = (folder / REPORT_FILE).read_text()
    assert "16,888 ± 24,925" in page  # the authors' train steps on the real task

    mlflow_client = client(copy)
    experiment = mlflow_client.get_experiment_by_name("CartPole-v0")
    assert experiment is not None
    runs = {run.info.run_name: run for run in mlflow_client.search_runs([experiment.experiment_id])}
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    tracked = runs["experiment-smoke-transfer-ddqn-seed0"]
    assert tracked.data.tags["bilevel.size"] == "smoke"
    findings = StoredFindings.read(folder.with_name(tracked.info.run_name))
    assert findings is not None
    assert [row["agents"] for row in findings.summary] == [2] * 4  # also on equal SEs
    real = next(row for row in findings.summary if row["source"] == "real")
    assert tracked.data.metrics["test_return/ddqn/real"] == real["test_return"]
    files = {item.path for item in mlflow_client.list_artifacts(tracked.info.run_id)}
    assert {"ddqn.svg", "data.csv", "settings.json", "findings.json", RESULTS_FILE} <= files
    run_id = runs[folder.name].info.run_id
    assert REPORT_FILE in {item.path for item in mlflow_client.list_artifacts(run_id)}

    listed = run_bilevel("runs", "--home", copy)
    assert f"3/3 SEs, {len(after)} agents" in listed.stdout
    synced = run_bilevel("sync", tracked.info.run_name, "--home", copy)
    assert synced.returncode == 0, synced.stderr

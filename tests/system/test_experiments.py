"""`bilevel experiment` as a user runs it: real Ray, MLflow and kills."""

import html
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
    """Test returns of the agents on disk, by the digest of what was asked."""
    folder = home / "CartPole-v0" / "experiment-smoke-transfer-ddqn-seed0"
    lines = (folder / RESULTS_FILE).read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    assert len({key for key, _ in rows}) == len(rows)  # none twice
    return {key: result["test_returns"] for key, result in rows}


def test_an_experiment_that_is_killed_and_carried_elsewhere(tmp_home: Path, address: str) -> None:
    """Killed during NES and copied to another place, it resumes there, adds more agents, and gives
    what one call gives; the report holds it, and MLflow has both."""
    joined = ("--address", address)
    with run_until("generation   0", *TRANSFER, *joined, "--home", tmp_home) as process:
        os.killpg(process.pid, signal.SIGKILL)
    elsewhere = tmp_home / "elsewhere"
    shutil.copytree(tmp_home / "CartPole-v0", elsewhere / "CartPole-v0")
    shutil.copy(tmp_home / "mlflow.db", elsewhere)
    first = run_bilevel(*TRANSFER, *joined, "--home", elsewhere, "--agents", "1", "--workers", "1")
    assert first.returncode == 0, first.stderr
    assert "data:" in first.stdout
    before = agents(elsewhere)
    more = run_bilevel(*TRANSFER, *joined, "--home", elsewhere, "--workers", "1")
    assert more.returncode == 0, more.stderr
    assert "generation" not in more.stdout  # SEs are there
    after = agents(elsewhere)
    assert before.items() < after.items()

    at_once = run_bilevel(*TRANSFER, *joined, "--home", tmp_home)
    assert at_once.returncode == 0, at_once.stderr
    assert agents(tmp_home) == after

    report = ("experiment", "report", *TRANSFER[2:], "--home", elsewhere)
    written = run_bilevel(*report)
    assert written.returncode == 0, written.stderr
    folder = elsewhere / "CartPole-v0" / "experiment-smoke-report-ddqn-seed0"
    others = run_bilevel(*report, "--solved-reward", "100")
    assert others.returncode == 2
    assert "was begun with task.solved_reward = 195.0, not 100.0" in others.stderr
    text = (folder / REPORT_FILE).read_text()
    assert "16\u202f888 ± 24\u202f925" in text  # the authors' train steps on the real task
    assert "Not run yet: success" in text
    assert "<svg" in text

    mlflow_client = client(elsewhere)
    experiment = mlflow_client.get_experiment_by_name("CartPole-v0")
    assert experiment is not None
    runs = {run.info.run_name: run for run in mlflow_client.search_runs([experiment.experiment_id])}
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    assert "experiment-smoke-varied-narrowed-seed0" in runs  # an NES run like any other
    shown = runs["experiment-smoke-transfer-ddqn-seed0"]
    assert shown.data.tags["bilevel.size"] == "smoke"
    findings = StoredFindings.read(folder.with_name(shown.info.run_name))
    assert findings is not None
    assert [row["agents"] for row in findings.summary] == [2] * 4  # also where two SEs are equal
    real = next(row for row in findings.summary if row["source"] == "real")
    assert shown.data.metrics["test_return/ddqn/real"] == real["test_return"]
    files = {item.path for item in mlflow_client.list_artifacts(shown.info.run_id)}
    assert {"ddqn.svg", "data.csv", "settings.json", "findings.json", RESULTS_FILE} <= files
    page = runs["experiment-smoke-report-ddqn-seed0"]
    assert REPORT_FILE in {item.path for item in mlflow_client.list_artifacts(page.info.run_id)}

    listed = run_bilevel("runs", "--home", elsewhere)
    assert f"3/3 SEs, {len(after)} agents" in listed.stdout
    synced = run_bilevel("sync", shown.info.run_name, "--home", elsewhere)
    assert synced.returncode == 0, synced.stderr


def test_success_grows_with_each_nes_run(tmp_home: Path, address: str) -> None:
    """Killed before its last NES runs, which go seed by seed, it has findings on those that have
    ended, and the report tells of how many."""
    task = ("CartPole-v0", "--size", "smoke", "--ses", "2", "--home", tmp_home)
    success = ("experiment", "success", *task)
    with run_until(
        "NES run 2 of 6: authors' rule, seed 0", *success, "--address", address
    ) as process:
        os.killpg(process.pid, signal.SIGKILL)
    folder = tmp_home / "CartPole-v0" / "experiment-smoke-success-seed0"
    findings = StoredFindings.read(folder)
    assert findings is not None
    assert findings.runs == {"default": 1}
    assert [row["condition"] for row in findings.summary] == ["default"]
    report = run_bilevel("experiment", "report", *task)
    assert report.returncode == 0, report.stderr
    page = (folder.with_name("experiment-smoke-report-seed0") / REPORT_FILE).read_text()
    assert "Under way: success (1 of 6 NES runs have ended)." in page
    told = "SE, our recipe: 1 of 2; authors' rule: 0 of 2; Algorithm 1: 0 of 2"
    assert html.escape(told) in page

    fewer = ("--ses", "1", "--address", address, "--workers", "1")
    ended = run_bilevel(*success, *fewer)
    assert ended.returncode == 0, ended.stderr
    findings = StoredFindings.read(folder)
    assert findings is not None
    assert findings.runs == {"default": 1, "authors": 1, "paper": 1}

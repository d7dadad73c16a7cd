"""`bilevel evaluate` and user-defined agents with real Ray, MLflow and kills."""

import json
import os
import re
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from bilevel.synthetic_env import load_se
from cluster.cli.program import cli
from cluster.storage.run_folder import BEST_FILE
from tests.commands import run_bilevel
from tests.documents import documented_agent
from tests.faults.stage import ONE_BY_ONE
from tests.system.conftest import client, run_until

pytestmark = pytest.mark.timeout(280)

#: End of an agent file that deletes itself when it is imported, so that actors cannot read it.
DELETED = """
from pathlib import Path

Path(__file__).unlink(missing_ok=True)
"""
FEW = ("--max-episodes", "13", "--name", "few")


def results(home: Path) -> dict[tuple[str, str, int], dict[str, Any]]:
    """Return the stored results without measured times."""
    lines = (home / "CartPole-v0" / "few" / "results.jsonl").read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    assert len({tuple(row[:3]) for row in rows}) == len(rows)  # no duplicates
    timeless = {"seconds": 0.0, "index": 0}
    return {(label, agent, i): {**fields, **timeless} for label, agent, i, fields in rows}


def test_agents_on_an_se_and_on_the_real_task(tmp_path: Path, se_file: Path, address: str) -> None:
    """A call that is killed and resumed with more agents and one worker has the results of one call
    with two workers."""
    both = ("evaluate", se_file, "--real", "CartPole-v0", "--agent", "ddqn,td3", *FEW)
    path = tmp_path / "CartPole-v0" / "few" / "results.jsonl"
    with run_until(
        *("fresh ddqn, td3 agents", *both, "--agents", "2"),
        *("--home", tmp_path, "--address", address),
    ) as process:
        while not path.exists() or path.read_bytes().count(b"\n") < 2:
            assert process.poll() is None
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGKILL)
    with path.open("ab") as file:
        file.write(b'["se", "ddqn", 7, {"test_ret')  # an unfinished line
    three = (*both, "--agents", "3", "--address", address)
    more = run_bilevel(*three, "--home", tmp_path, "--workers", "1")
    assert more.returncode == 0, more.stderr
    rows = [line.split() for line in more.stdout.splitlines()]
    assert re.search(r"MLflow http\S+/runs/\w{32}\?workflowType=machine_learning", more.stdout)
    table = [[source, agent, "3"] for source in ("se", "real") for agent in ("ddqn", "td3")]
    assert [row[:3] for row in rows if row[:1] in (["se"], ["real"])] == table

    one_call = run_bilevel(*three, "--home", tmp_path / "other")
    assert one_call.returncode == 0, one_call.stderr
    assert results(tmp_path) == results(tmp_path / "other")

    folder = tmp_path / "CartPole-v0" / "few"
    report = json.loads((folder / "report.json").read_text())
    scores = [
        np.mean(value["test_returns"])
        for (label, agent, _), value in results(tmp_path).items()
        if (label, agent) == ("se", "td3")
    ]
    (group,) = [g for g in report if (g["source"], g["agent"]) == ("se", "td3")]
    assert group["test_returns_mean"] == pytest.approx(np.mean(scores))
    assert group["agents"] == 3
    assert (folder / "returns.png").read_bytes().startswith(b"\x89PNG")

    mlflow_client = client(tmp_path)
    experiment = mlflow_client.get_experiment_by_name("CartPole-v0")
    assert experiment is not None
    (tracked,) = mlflow_client.search_runs([experiment.experiment_id])
    assert tracked.info.status == "FINISHED"
    assert tracked.data.metrics["test_return/td3/se"] == group["test_returns_mean"]
    names = {item.path for item in mlflow_client.list_artifacts(tracked.info.run_id)}
    assert {"report.json", "returns.png", "results.jsonl"} <= names


def test_nes_with_a_custom_agent(tmp_path: Path, address: str) -> None:
    """The example agent of docs/agents.md, next to DDQN. Actors get its file and an imported module
    from the command."""
    file, parts = tmp_path / "mine.py", tmp_path / "parts.py"
    code, registration, rest = documented_agent().partition("register_agent(Reinf")
    parts.write_text(code)
    importing = "from parts import Reinforce, ReinforceHyperparameters, register_agent\n"
    chosen: tuple[str | Path, ...] = ("--agent", "ddqn,reinforce", "--agent-file", file)
    small = (
        *("--population", "2", "--set", "nes.start_candidates=1", "--set", "nes.centre_agents=2"),
        *("--set", "ddqn.max_episodes=13", "--set", "reinforce.max_episodes=13"),
        *("--set", "ddqn.test_episodes=2", "--set", "reinforce.test_episodes=2"),
        *("--set", "ddqn.init_episodes=5", "--vary-hp", "no"),
        *("--set", "ddqn.hidden_size=16", "--set", "ddqn.batch_size=16"),
    )
    common = ("nes", "CartPole-v0", *chosen, *small, "--generations", "1", "--name", "mixed")
    joined = (*common, "--address", address)
    found = []
    for workers in ("1", "2"):
        file.write_text(f"{importing}{registration}{rest}{DELETED}")
        result = run_bilevel(*joined, "--workers", workers, "--home", tmp_path / workers)
        assert result.returncode == 0, result.stderr
        assert "generation   0  score" in result.stdout
        folder = tmp_path / workers / "CartPole-v0" / "mixed"
        found.append(load_se(folder / BEST_FILE).se.psi)
    np.testing.assert_array_equal(found[0], found[1])


def test_an_error_in_a_custom_agent_is_one_line(tmp_path: Path, address: str) -> None:
    """The command reports errors of actors that it runs and of those in a trial."""
    file = tmp_path / "reinforce.py"
    file.write_text(
        documented_agent().replace(
            "return int(torch", "raise KeyError('no action')\n        return int(torch"
        )
        + DELETED
    )
    agent = ("--agent", "reinforce", "--agent-file", file)
    chosen = (*agent, "--home", tmp_path, "--address", address)
    smoke = ("bohb", "--profile", "smoke", *ONE_BY_ONE)
    code = file.read_text()
    for command in (("evaluate", "--workers", "1", "--real"), smoke):
        name, *options = command
        file.write_text(code)
        result = run_bilevel(name, *options, "CartPole-v0", *chosen)
        assert result.returncode == 2, result.stdout
        assert result.stderr.count("\n") == 1
        assert f"agent 'reinforce' at {file}:" in result.stderr
        assert "KeyError: 'no action'" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("SE", "--agent", "td3,td3"), "each agent once"),
        (
            ("SE", "--real", "CartPole-v0", "--step-limit", "100"),
            "CartPole-v0 (100 steps, solved at 195), CartPole-v0 (200 steps, solved at 195)",
        ),
        (("SE", "SE", "SE"), "two sources are called"),
        (("SE", "--max-episodes", "10"), "ddqn.init_episodes must be below ddqn.max_episodes"),
    ],
)
def test_invalid_input(
    arguments: tuple[str, ...], message: str, tmp_path: Path, se_file: Path
) -> None:
    given = [str(se_file) if argument == "SE" else argument for argument in arguments]
    result = CliRunner().invoke(cli, ["evaluate", *given, "--home", str(tmp_path / "home")])
    assert result.exit_code == 2
    assert message in result.stderr
    assert not (tmp_path / "home").exists()

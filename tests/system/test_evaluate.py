"""`bilevel evaluate` and user-defined agents, as a user runs them: real Ray, MLflow and kills."""

import json
import os
import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy

from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env import SE, Architecture, StoredSE, save_se
from bilevel.tasks import get_task
from cluster.nes.run import STATE_FILE
from tests.commands import run_bilevel
from tests.documents import documented_agent
from tests.faults.stage import ONE_BY_ONE
from tests.system.conftest import client, run_until

pytestmark = pytest.mark.timeout(280)

#: End of an agent file that is gone once it was imported, as on a machine which does not have it.
GOING = """
from pathlib import Path

Path(__file__).unlink(missing_ok=True)
"""
FEW = ("--max-episodes", "13", "--name", "few")


@pytest.fixture
def se_file(tmp_path: Path) -> Path:
    task = get_task("CartPole-v0")
    hp = SEHyperparameters(
        structure="plain",
        hidden_layers=1,
        hidden_size=16,
        activation="lrelu",
        step_limit=30,
        spread=1.0,
    )
    architecture = Architecture.of(task, hp)
    se = SE(architecture, architecture.initialize(np.random.default_rng(0)))
    path = tmp_path / "my_se.safetensors"
    save_se(StoredSE(se, task.id, task.step_limit, task.solved_reward), path)
    return path


def results(home: Path) -> dict[tuple[str, str, int], dict[str, Any]]:
    """The results on disk without the measured times."""
    lines = (home / "CartPole-v0" / "few" / "results.jsonl").read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    assert len({tuple(row[:3]) for row in rows}) == len(rows)  # none twice
    timeless = {"seconds": 0.0, "index": 0}
    return {(label, agent, i): {**fields, **timeless} for label, agent, i, fields in rows}


def test_agents_on_an_se_and_on_the_real_task(tmp_path: Path, se_file: Path, address: str) -> None:
    """A call that is killed and resumed with more agents by one worker gives the results of one
    call with two workers."""
    both = ("evaluate", se_file, "--real", "CartPole-v0", "--agent", "ddqn,td3", *FEW)
    path = tmp_path / "CartPole-v0" / "few" / "results.jsonl"
    with run_until(
        *("fresh ddqn and td3 agents", *both, "--agents", "2"),
        *("--home", tmp_path, "--address", address),
    ) as process:
        while not path.exists() or path.read_bytes().count(b"\n") < 2:
            assert process.poll() is None
        os.killpg(process.pid, signal.SIGKILL)
    with path.open("ab") as file:
        file.write(b'["my_se", "ddqn", 7, {"test_ret')  # a line cut short
    three = (*both, "--agents", "3", "--address", address)
    more = run_bilevel(*three, "--home", tmp_path, "--workers", "1")
    assert more.returncode == 0, more.stderr
    rows = [line.split() for line in more.stdout.splitlines() if line.startswith(("my_se", "real"))]
    assert re.search(r"MLflow http\S+/runs/\w{32}\?workflowType=machine_learning", more.stdout)
    assert [row[:3] for row in rows] == [
        [source, agent, "3"] for source in ("my_se", "real") for agent in ("ddqn", "td3")
    ]

    at_once = run_bilevel(*three, "--home", tmp_path / "other")
    assert at_once.returncode == 0, at_once.stderr
    assert results(tmp_path) == results(tmp_path / "other")

    folder = tmp_path / "CartPole-v0" / "few"
    report = json.loads((folder / "report.json").read_text())
    scores = [
        np.mean(value["test_returns"])
        for (label, agent, _), value in results(tmp_path).items()
        if (label, agent) == ("my_se", "td3")
    ]
    (group,) = [g for g in report if (g["source"], g["agent"]) == ("my_se", "td3")]
    assert group["test_returns_mean"] == pytest.approx(np.mean(scores))
    assert group["agents"] == 3
    assert (folder / "returns.png").read_bytes().startswith(b"\x89PNG")

    mlflow_client = client(tmp_path)
    experiment = mlflow_client.get_experiment_by_name("CartPole-v0")
    assert experiment is not None
    (tracked,) = mlflow_client.search_runs([experiment.experiment_id])
    assert tracked.info.status == "FINISHED"
    assert tracked.data.metrics["test_return/td3/my_se"] == group["test_returns_mean"]
    names = {item.path for item in mlflow_client.list_artifacts(tracked.info.run_id)}
    assert {"report.json", "returns.png", "results.jsonl"} <= names


def test_an_agent_of_the_users_own_in_nes(tmp_path: Path, address: str) -> None:
    """The example agent of docs/agents.md, one of two agents, on actors that import what the
    command has read, and a module beside it."""
    file, parts = tmp_path / "mine.py", tmp_path / "parts.py"
    code, registration, rest = documented_agent().partition("register_agent(Reinf")
    parts.write_text(code)
    importing = "from parts import Reinforce, ReinforceHyperparameters, register_agent\n"
    chosen: tuple[str | Path, ...] = ("--agent", "ddqn,reinforce", "--agent-file", file)
    small = (
        *("--population", "2", "--set", "nes.start_candidates=1", "--set", "nes.centre_agents=2"),
        *("--set", "ddqn.max_episodes=13", "--set", "reinforce.max_episodes=13"),
        *("--set", "ddqn.test_episodes=2", "--set", "reinforce.test_episodes=2"),
        *("--set", "se.step_limit=15", "--vary-hp", "no"),
        *("--set", "ddqn.hidden_size=16", "--set", "ddqn.batch_size=16"),
    )
    common = ("nes", "CartPole-v0", *chosen, *small, "--generations", "1", "--name", "mixed")
    joined = (*common, "--address", address)
    thetas = []
    for workers in ("1", "2"):
        file.write_text(f"{importing}{registration}{rest}{GOING}")
        result = run_bilevel(*joined, "--workers", workers, "--home", tmp_path / workers)
        assert result.returncode == 0, result.stderr
        assert "generation   0  score" in result.stdout
        state = tmp_path / workers / "CartPole-v0" / "mixed" / STATE_FILE
        thetas.append(safetensors.numpy.load_file(state)["theta"])
    np.testing.assert_array_equal(thetas[0], thetas[1])

    file.write_text(f"{importing}{registration}{rest}")
    parts.write_text(f"{code}\n# another version\n")
    resumed = run_bilevel(*joined, "--home", tmp_path / "1")
    assert resumed.returncode == 0, resumed.stderr
    assert "mixed: Begun and resumed with 2 versions of the agent 'reinforce'" in resumed.stdout


def test_a_mistake_in_the_users_own_agent_is_one_line(tmp_path: Path, address: str) -> None:
    """It is found in an actor, and told by the command, whether this process runs the actors or a
    trial does."""
    file = tmp_path / "reinforce.py"
    file.write_text(
        documented_agent().replace(
            "return int(torch.multinomial", "return 7 + int(torch.multinomial"
        )
        + GOING
    )
    chosen = (
        "--agent",
        "reinforce",
        "--agent-file",
        file,
        "--home",
        tmp_path,
        "--address",
        address,
    )
    smoke = ("bohb", "--profile", "smoke", *ONE_BY_ONE)
    code = file.read_text()
    for command in (("evaluate", "--workers", "1", "--real"), smoke):
        name, *options = command
        file.write_text(code)
        result = run_bilevel(name, *options, "CartPole-v0", *chosen)
        assert result.returncode == 2, result.stdout
        assert result.stderr.count("\n") == 1
        assert f"agent 'reinforce' at {file}:" in result.stderr
        assert "act: action" in result.stderr
        assert "Traceback" not in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "nothing to train on: give SE files, or --real TASK"),
        (("missing.safetensors",), "no SE file at 'missing.safetensors'"),
        (("--real", "Pong-v99"), "unknown task 'Pong-v99'"),
        (("--real", "CartPole-v0", "--agent", "dqn"), "unknown agent 'dqn': allowed are ddqn"),
        (("--real", "CartPole-v0", "--agent", "td3,td3"), "each once"),
        (
            ("SE", "--real", "Acrobot-v1"),
            "all sources must have the same task; got Acrobot-v1 (500 steps",
        ),
        (("SE", "--step-limit", "100"), "--solved-reward and --step-limit need --real"),
        (
            ("SE", "--real", "CartPole-v0", "--step-limit", "100"),
            "CartPole-v0 (100 steps, solved at 195), CartPole-v0 (200 steps, solved at 195)",
        ),
        (("SE", "SE", "SE"), "two sources are called"),
        (("SE", "--agents", "0"), "0 is not in the range"),
        (("SE", "--max-episodes", "10"), "ddqn.init_episodes must be below ddqn.max_episodes, 10"),
    ],
)
def test_bad_input_is_one_line(
    arguments: tuple[str, ...], message: str, tmp_path: Path, se_file: Path
) -> None:
    given = [str(se_file) if argument == "SE" else argument for argument in arguments]
    result = run_bilevel("evaluate", *given, "--home", tmp_path / "home")
    assert result.returncode == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "home").exists()

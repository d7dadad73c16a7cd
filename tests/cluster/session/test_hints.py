"""Commands and addresses in messages."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import pytest

from bilevel.tasks import get_task
from cluster.ray.agent_files import load_agent_file
from cluster.session.hints import agent_options, task_options, tracking_option
from cluster.session.session import shown_at
from cluster.storage.home import Home
from tests.agent_files import forgotten_afterwards
from tests.documents import documented_agent

UNKNOWN = "test/WithoutThreshold-v0"


@pytest.mark.parametrize(
    ("task_id", "values", "options"),
    [
        ("CartPole-v0", {}, ""),
        ("CartPole-v0", {"solved_reward": 100.0}, " --solved-reward 100"),
        (
            "Acrobot-v1",
            {"step_limit": 150, "worst_score": -200.5},
            " --step-limit 150 --worst-score -200.5",
        ),
        (
            "CartPole-v0",
            {"solved_reward": 195.1234567, "step_limit": 1_000_000},
            " --solved-reward 195.1234567 --step-limit 1000000",
        ),
        (UNKNOWN, {"solved_reward": 50, "step_limit": 80}, " --solved-reward 50 --step-limit 80"),
    ],
)
def test_options_for_values_that_differ_from_the_defaults_of_a_task(
    task_id: str, values: dict[str, Any], options: str
) -> None:
    if task_id == UNKNOWN and UNKNOWN not in gymnasium.registry:
        gymnasium.register(UNKNOWN, "gymnasium.envs.classic_control:CartPoleEnv")
    assert task_options(get_task(task_id, **values)) == options


def test_options_for_agent_files(tmp_path: Path) -> None:
    with forgotten_afterwards():
        assert agent_options() == ""
        (tmp_path / "a folder").mkdir()
        files = [tmp_path / "first_hinted.py", tmp_path / "a folder" / "second_hinted.py"]
        for file in files:
            file.write_text(documented_agent().replace('"reinforce"', f'"{file.stem}"'))
            load_agent_file(file)
        assert agent_options() == f" --agent-file {files[0]} --agent-file '{files[1]}'"


def test_no_message_contains_a_password(tmp_path: Path) -> None:
    server = "http://me:secret@mlflow:5000"
    tracker: Any = SimpleNamespace(uri=server, server=server, page=lambda key: "/#/experiments")
    for text in (tracking_option(server), shown_at(Home(tmp_path), tracker)):
        assert "mlflow:5000" in text
        assert "secret" not in text

"""`bilevel zoo`: listing it, and building an SE."""

import json
from hashlib import sha256
from pathlib import Path

import pytest

from bilevel.hyperparameters import Hyperparameters
from bilevel.synthetic_env import load_se
from bilevel.zoo import ENTRIES, Entry, env_id
from cluster.session.context import RunContext
from cluster.storage.home import Home
from cluster.zoo import build
from tests.commands import run_bilevel

pytestmark = pytest.mark.timeout(200)


def test_listing(tmp_path: Path) -> None:
    result = run_bilevel("zoo", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    for name in ENTRIES:
        assert env_id(name) in result.stdout
    assert list(tmp_path.iterdir()) == []


def test_building_an_se_and_its_card(
    tmp_home: Path, address: str, small_hp: Hyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The recipe and the agents are small; a second call resumes."""
    monkeypatch.setattr("cluster.zoo.load_recipe", lambda name, task: small_hp)
    monkeypatch.setattr("cluster.zoo.usual_agents", lambda *given: small_hp.agents)
    home, folder = Home(tmp_home), tmp_home / "made"
    context = RunContext(home, home.database_uri, address)
    entry = Entry("tiny", "CartPole-v0", 7)
    card = build(entry, context, folder, agents=1)
    path = folder / "tiny.safetensors"
    assert card.sha256 == sha256(path.read_bytes()).hexdigest()
    steps = json.loads((folder / "tiny.json").read_text())["real_env_steps"]
    assert steps == load_se(path).info["real_env_steps"] == card.real_env_steps
    assert [(row.agent, row.agents) for row in card.scores] == [
        (hp.agent, 1) for hp in small_hp.agents
    ]
    assert build(entry, context, folder, agents=1) == card

"""`bilevel zoo`: listing it, and making an SE of it anew."""

import json
from hashlib import sha256
from pathlib import Path

import pytest

from bilevel.hyperparameters import Hyperparameters
from bilevel.synthetic_env import load_se
from bilevel.zoo import ENTRIES, Entry, env_id
from cluster.session.context import RunContext
from cluster.storage.home import Home
from cluster.zoo.build import BuildCommand, build
from tests.commands import run_bilevel

pytestmark = pytest.mark.timeout(200)


def test_listing(tmp_path: Path) -> None:
    result = run_bilevel("zoo", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    for name in ENTRIES:
        assert env_id(name) in result.stdout
    wrong = run_bilevel("zoo", "build", "Pong", cwd=tmp_path)
    assert wrong.returncode == 2
    assert "unknown SE of the zoo 'Pong': allowed are CartPole-v0, Acrobot-v1" in wrong.stderr
    assert list(tmp_path.iterdir()) == []


def test_an_se_and_its_card_are_made(
    tmp_home: Path, address: str, small_hp: Hyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As `zoo build` does it, with a small recipe and few, small agents; again, it resumes."""
    small = small_hp.agents
    monkeypatch.setattr("cluster.zoo.build.load_recipe", lambda name, task: small_hp)
    monkeypatch.setattr("cluster.zoo.build.default_agents", lambda names: small)
    home, folder = Home(tmp_home), tmp_home / "made"
    command = BuildCommand(
        Entry("tiny", "CartPole-v0", 7),
        RunContext(home, home.database_uri, address),
        folder,
        agents=1,
    )
    card = build(command)
    path = folder / "tiny.safetensors"
    assert card.sha256 == sha256(path.read_bytes()).hexdigest()
    told = json.loads((folder / "tiny.json").read_text())
    assert told["real_env_steps"] == load_se(path).info["real_env_steps"] == card.real_env_steps
    assert [taught.agent for taught in card.taught] == [hp.agent for hp in small]
    assert all(taught.agents == 1 for taught in card.taught)
    assert build(command) == card

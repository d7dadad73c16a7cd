"""The agents of `bilevel evaluate`."""

from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from bilevel.hyperparameters import default_agents
from bilevel.recipes import load_recipe
from cluster.cli.program import cli
from cluster.evaluate.command import EvaluateCommand

FROM_ZOO = ("evaluate", "CartPole-v0", "--real", "CartPole-v0")


def command_of(
    words: tuple[str, ...], home: Path, monkeypatch: pytest.MonkeyPatch
) -> EvaluateCommand:
    """Return what the command line would run."""
    given: list[EvaluateCommand] = []
    monkeypatch.setattr("cluster.evaluate.command.run_evaluate", given.append)
    result = CliRunner().invoke(cli, [*words, "--home", str(home)])
    assert result.exit_code == 0, result.output
    (command,) = given
    return command


def test_agents_fit_their_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The zoo's SE has episodes of one step."""
    words = (*FROM_ZOO, "--agent", "ddqn,ppo")
    kinds = command_of(words, tmp_path, monkeypatch).kinds
    on_se, on_real = kinds.values()
    assert list(kinds)[-1] == "real"
    assert on_se == load_recipe("default", "CartPole-v0", ("ddqn", "ppo")).agents
    assert on_real == default_agents(("ddqn", "ppo"))


def test_given_values_hold_for_all_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = (*FROM_ZOO, "--max-episodes", "900", "--set", "ddqn.batch_size=7")
    command = command_of((*words, "--recipe", "paper"), tmp_path, monkeypatch)
    (agent,) = load_recipe("paper", "CartPole-v0").agents
    changed = replace(agent, max_episodes=900, batch_size=7)  # type: ignore[call-arg]
    assert set(command.kinds.values()) == {(changed,)}

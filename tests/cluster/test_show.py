"""Pictures of SEs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.contour import ContourSet

from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SE, family_of, save_se
from bilevel.tasks import Task, get_task
from cluster.cli.program import cli
from cluster.show import GRID, VALUES, SEPlot, answers, picture
from tests.commands import run_bilevel
from tests.ses import make_se


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Pendulum-v1", "FrozenLake-v1"])
def test_answers_and_episodes_follow_the_se(task_id: str) -> None:
    task = get_task(task_id)
    se = make_se(task)
    plot = SEPlot.of(se)
    actions = VALUES if task.continuous else task.action_size
    assert plot.positions.min() == 0
    assert plot.positions.max() == 1
    assert plot.answers.next_states.shape == (actions * GRID**2, task.state_size)
    (across, up), indices = plot.axes, plot.labels.axes
    assert plot.answers.states[-1, indices].tolist() == [across[-1], up[-1]]
    for episode in plot.episodes:
        assert len(episode.states) == len(episode.actions) + 1 <= task.step_limit + 1
        before = len(episode.actions) - 1
        best = answers(se, episode.states[[before]]).rewards.argmax()
        assert best == episode.actions[before]
    assert len(picture(plot, "title").axes) == 2


def test_episodes_follow_gymnasium(cartpole: Task) -> None:
    episode = SEPlot.of(make_se(cartpole)).episodes[1]
    env = cartpole.make()
    states = [env.reset(seed=1)[0]]
    rewards = []
    for action in episode.actions:
        state, reward, *_ = env.step(np.int64(action))
        states.append(state)
        rewards.append(float(reward))
    np.testing.assert_array_equal(episode.states, np.array(states, np.float32))
    assert episode.total == sum(rewards)


@pytest.mark.parametrize("kind", ["never", "somewhere", "always"])
def test_states_in_which_episodes_end_are_hatched(kind: str, cartpole: Task) -> None:
    """Unless all episodes have one step."""
    se = make_se(cartpole)
    if kind == "always":
        psi = se.psi.copy()
        psi[-1] = 50.0  # the last bias, of done
        se = replace(se, se=SE(se.architecture, psi))
    elif kind == "somewhere":
        hp = load_recipe("exogenous", cartpole).se
        family = family_of(cartpole, hp, cartpole.observation_scale(0))
        psi = family.psi(family.initialize(np.random.default_rng(0)))
        se = replace(se, se=SE(family.architecture, psi))
    on_se = picture(SEPlot.of(se), "title").axes[0]
    assert any(isinstance(one, ContourSet) for one in on_se.collections) is (kind == "somewhere")


def test_the_command(se_file: Path, tmp_path: Path) -> None:
    shown = run_bilevel("show", se_file, "--out", tmp_path / "se.svg", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "taking the action that the SE rewards most earns" in shown.stdout
    assert shown.stdout.endswith(f"picture: {tmp_path / 'se.svg'}\n")
    assert b"<svg" in (tmp_path / "se.svg").read_bytes()
    default = run_bilevel("show", "CartPole-v0", cwd=tmp_path)
    assert default.returncode == 0, default.stderr
    assert (tmp_path / "Synthetic-CartPole-v0.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("CartPole-v1",), "or a name of the zoo, CartPole-v0 or Acrobot-v1"),
        (("SE", "--out", "none/se.png"), "cannot write 'none/se.png': No such file"),
        (("UNKNOWN",), "unknown task 'Nowhere-v0'"),
    ],
)
def test_invalid_input(
    words: tuple[str, ...], message: str, cartpole: Task, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    se = make_se(cartpole)
    save_se(se, tmp_path / "SE")
    save_se(replace(se, task_id="Nowhere-v0"), tmp_path / "UNKNOWN")
    result = CliRunner().invoke(cli, ["show", *words])
    assert result.exit_code == 2
    assert message in result.stderr

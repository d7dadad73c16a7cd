"""Pictures of SEs."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from matplotlib.contour import ContourSet
from matplotlib.quiver import Quiver

from bilevel.errors import InvalidInput
from bilevel.synthetic_env import SE, load_se, save_se
from bilevel.tasks import Task, get_task
from bilevel.zoo import zoo_file
from cluster.cli.program import cli
from cluster.pictures import GREY
from cluster.show.picture import colours_of, picture
from cluster.show.portrait import GRID, Portrait
from tests.commands import run_bilevel
from tests.ses import make_se


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"])
def test_transitions_and_episodes_follow_the_se(task_id: str) -> None:
    task = get_task(task_id)
    portrait = Portrait.of(make_se(task))
    assert len(portrait.actions) == task.n_actions
    assert portrait.transitions.next_states.shape == (task.n_actions * GRID**2, task.state_size)
    (across, up), (i, j) = portrait.axes, portrait.indices
    assert (portrait.states[-1, i], portrait.states[-1, j]) == (across[-1], up[-1])
    for episode in portrait.synthetic:
        for state, action, after in zip(
            episode.states[:-1], episode.actions, episode.states[1:], strict=True
        ):
            answers = portrait.answers(state[None])
            assert action == answers.rewards.argmax()
            np.testing.assert_array_equal(after, answers.next_states[action])
        assert len(episode.actions) <= portrait.se.architecture.step_limit
    for episode in portrait.real:
        assert len(episode.states) == len(episode.actions) + 1 <= task.step_limit + 1
        assert portrait.answers(episode.states[3:4]).rewards.argmax() == episode.actions[3]
    assert len(picture(portrait, "title").axes) == 6


def test_real_episodes_follow_gymnasium(cartpole: Task) -> None:
    episode = Portrait.of(make_se(cartpole)).real[1]
    env = cartpole.make()
    states = [env.reset(seed=1)[0]]
    rewards = []
    for action in episode.actions:
        state, reward, *_ = env.step(np.int64(action))
        states.append(state)
        rewards.append(float(reward))
    np.testing.assert_array_equal(episode.states, np.array(states, np.float32))
    assert episode.total == sum(rewards)


@pytest.mark.parametrize(("path", "arrows"), [("plain", [2, 2]), ("CartPole-v0", [1, 2])])
def test_each_action_has_arrows_unless_all_lead_to_the_same_states(
    path: str, arrows: list[int], cartpole: Task
) -> None:
    """The zoo's SE ignores the action in its next states."""
    se = make_se(cartpole) if path == "plain" else load_se(zoo_file(path))
    panels = picture(Portrait.of(se), "title").axes
    found = [sum(isinstance(one, Quiver) for one in panels[k].collections) for k in (1, 4)]
    assert found == arrows
    hatched = any(isinstance(one, ContourSet) for one in panels[1].collections)
    assert hatched is (path != "plain")  # no state on the plain SE's grid ends an episode


@pytest.mark.parametrize("actions", [1, 2, 5, 6, 18])
def test_actions_have_different_colours(actions: int) -> None:
    assert len({*colours_of(actions), GREY}) == actions + 1


def test_an_se_that_always_ends_is_hatched_everywhere(cartpole: Task) -> None:
    made = make_se(cartpole)
    psi = made.psi.copy()
    psi[-1] = 50.0  # the last bias, of done
    panels = picture(Portrait.of(replace(made, se=SE(made.architecture, psi))), "title").axes
    assert any(isinstance(one, ContourSet) for one in panels[1].collections)


class Line(gymnasium.Env[Any, Any]):
    """An environment with one observation whose reward is the action."""

    observation_space = gymnasium.spaces.Box(-9, 9, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        return self.np_random.standard_normal(1).astype(np.float32), {}

    def step(self, action: Any) -> Any:
        state = self.np_random.standard_normal(1).astype(np.float32)
        return state, float(action), False, False, {}


def test_a_task_with_one_observation_and_varying_rewards(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = EnvSpec("test/Line-v0", lambda **_: Line(), reward_threshold=9.0, max_episode_steps=9)
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    drawn = picture(Portrait.of(make_se(get_task(spec.id))), "Line")
    assert len(drawn.axes) == 7  # with a colour bar of the rewards


def test_the_command(se_file: Path, tmp_path: Path) -> None:
    shown = run_bilevel("show", se_file, "--out", tmp_path / "se.svg", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "taking the action that it rewards most earns" in shown.stdout
    assert shown.stdout.endswith(f"picture: {tmp_path / 'se.svg'}\n")
    assert b"<svg" in (tmp_path / "se.svg").read_bytes()
    default = run_bilevel("show", "CartPole-v0", cwd=tmp_path)
    assert default.returncode == 0, default.stderr
    assert (tmp_path / "Synthetic-CartPole-v0.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nothing.safetensors",), "no SE file at 'nothing.safetensors': give a path, MLflow's"),
        (("CartPole-v1",), "or a name of the zoo, CartPole-v0 or Acrobot-v1"),
        (("SE", "--out", "se.bmp"), "cannot draw 'se.bmp': allowed are files .png, .svg, .pdf"),
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
    with pytest.raises((InvalidInput, click.ClickException), match=re.escape(message)):
        cli.main(["show", *words], standalone_mode=False)

"""The picture of an SE shows what the SE says."""

from dataclasses import replace
from pathlib import Path
from typing import Any

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
from cluster.pictures import GREY
from cluster.show.picture import _colours, picture
from cluster.show.portrait import GRID, Portrait, _met
from tests.commands import run_bilevel
from tests.ses import make_se


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"])
def test_fields_and_episodes_are_the_ses(task_id: str) -> None:
    task = get_task(task_id)
    portrait = Portrait.of(make_se(task))
    assert len(portrait.actions) == task.n_actions
    following, rewards, dones = portrait.fields
    assert following.shape == (task.n_actions, GRID * GRID, task.state_size)
    assert rewards.shape == dones.shape == (task.n_actions, GRID * GRID)
    across, up = portrait.plane.axes
    i, j = portrait.plane.indices
    corner = portrait.plane.states[-1]
    assert (corner[i], corner[j]) == (across[-1], up[-1])
    for episode in portrait.synthetic:
        for state, action, after in zip(
            episode.states[:-1], episode.actions, episode.states[1:], strict=True
        ):
            answers = portrait.answers(state[None])
            assert action == answers[1][:, 0].argmax()
            np.testing.assert_array_equal(after, answers[0][action, 0])
        assert len(episode.actions) <= portrait.se.architecture.step_limit
    for episode in portrait.real:
        assert len(episode.states) == len(episode.actions) + 1 <= task.step_limit + 1
        assert portrait.rewarded(episode.states[3]) == episode.actions[3]
    drawn = picture(portrait, "title")
    reward = {"CartPole-v0": 1}.get(task_id, -1)
    told = "hatched: it ends" if task.compiled else "600 random steps"
    assert [axes.get_title() for axes in drawn.axes][:5] == [
        "the action that the SE rewards most (pale: by little)",
        "where the SE goes next; hatched: it ends",
        "episodes on the SE",
        f"rewards of the real task: {reward}, whatever the action",
        f"where the real task goes next; {told}",
    ]


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"])
def test_the_real_tasks_transitions_are_gymnasiums(task_id: str) -> None:
    """MountainCar's are those of random actions."""
    task = get_task(task_id)
    found = Portrait.of(make_se(task)).real_transitions
    assert found.whole is task.compiled
    env = task.make()
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for row in rng.integers(len(found.states), size=20):
        for action in range(task.n_actions):
            if np.isnan(found.rewards[action, row]):
                continue
            state = found.states[row]
            physics = task.physics(state) if task.compiled else state
            env.unwrapped.state = np.array(physics, np.float64)  # type: ignore[attr-defined]
            if env.spec is not None and task.id.startswith("CartPole"):
                env.unwrapped.steps_beyond_terminated = None  # type: ignore[attr-defined]
            after, reward, over, _, _ = env.unwrapped.step(np.int64(action))
            np.testing.assert_allclose(found.following[action, row], after, rtol=1e-4, atol=1e-5)
            assert found.rewards[action, row] == reward
            assert found.ends[action, row] == over
    env.close()


@pytest.mark.parametrize(("path", "arrows"), [("plain", [2, 2]), ("CartPole-v0", [1, 2])])
def test_actions_that_lead_elsewhere_have_arrows_of_their_own(
    path: str, arrows: list[int], cartpole: Task
) -> None:
    """The SE of the zoo goes the same way whatever the action; a plain one and the task do not."""
    se = make_se(cartpole) if path == "plain" else load_se(zoo_file(path))
    panels = picture(Portrait.of(se), "title").axes
    found = [sum(isinstance(one, Quiver) for one in panels[k].collections) for k in (1, 4)]
    assert found == arrows
    ends = [any(isinstance(one, ContourSet) for one in panels[k].collections) for k in (1, 4)]
    assert ends == [path != "plain", True]  # inside the plane the plain one never ends


@pytest.mark.parametrize("actions", [1, 2, 5, 6, 18])
def test_every_action_has_a_colour_of_its_own(actions: int) -> None:
    assert len({*_colours(actions), GREY}) == actions + 1  # grey is of all actions


def test_an_se_that_ends_everywhere_is_hatched_everywhere(cartpole: Task) -> None:
    """It must not look like one that never ends."""
    made = make_se(cartpole)
    psi = made.psi.copy()
    psi[-1] = 50.0  # the last bias, of done
    panels = picture(Portrait.of(replace(made, se=SE(made.architecture, psi))), "title").axes
    assert any(isinstance(one, ContourSet) for one in panels[1].collections)


def test_random_steps_stand_for_a_task_that_is_not_compiled(cartpole: Task) -> None:
    met = _met(replace(cartpole, dynamics=0))
    tried = ~np.isnan(met.rewards)
    assert (tried.sum(axis=0) == 1).all()
    fallen = np.abs(met.following[..., 2]) > 12 * np.pi / 180
    assert fallen.any()
    np.testing.assert_array_equal(met.ends, fallen)  # in so few steps the cart stays on the track


class Line(gymnasium.Env[Any, Any]):
    """One observation, and a reward that is the action."""

    observation_space = gymnasium.spaces.Box(-9, 9, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        return self.np_random.standard_normal(1).astype(np.float32), {}

    def step(self, action: Any) -> Any:
        state = self.np_random.standard_normal(1).astype(np.float32)
        return state, float(action), False, False, {}


def test_a_task_with_one_observation_whose_rewards_depend_on_actions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spec = EnvSpec("test/Line-v0", lambda **_: Line(), reward_threshold=9.0, max_episode_steps=9)
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    drawn = picture(Portrait.of(make_se(get_task(spec.id))), "Line")
    assert drawn.get_suptitle() == "Line, over its observation (on both axes)"
    assert drawn.axes[3].get_title() == "rewards of the real task for a random action"


def test_the_command(se_file: Path, tmp_path: Path) -> None:
    shown = run_bilevel("show", se_file, "--out", tmp_path / "se.svg", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "taking the action that it rewards most earns" in shown.stdout
    assert shown.stdout.endswith(f"picture: {tmp_path / 'se.svg'}\n")
    assert b"<svg" in (tmp_path / "se.svg").read_bytes()
    usual = run_bilevel("show", "CartPole-v0", cwd=tmp_path)
    assert usual.returncode == 0, usual.stderr
    assert (tmp_path / "Synthetic-CartPole-v0.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("nothing.safetensors",), "no SE file at 'nothing.safetensors': give a path, MLflow's"),
        (("CartPole-v1",), "or a name of the zoo, CartPole-v0 or Acrobot-v1"),
        (("SE", "--out", "se.bmp"), "cannot draw 'se.bmp': allowed are files .png, .svg, .pdf"),
        (("SE", "--out", "none/se.png"), "cannot write 'none/se.png': No such file"),
    ],
)
def test_bad_input_is_one_line(
    words: tuple[str, ...], told: str, se_file: Path, tmp_path: Path
) -> None:
    given = [str(se_file) if word == "SE" else word for word in words]
    result = run_bilevel("show", *given, cwd=tmp_path)
    assert result.returncode == 2
    assert told in result.stderr
    assert result.stderr.count("\n") == 1


def test_an_se_that_is_not_finite_is_refused(cartpole: Task) -> None:
    se = make_se(cartpole)
    se.se.psi[3] = np.nan
    with pytest.raises(InvalidInput, match="not finite"):
        Portrait.of(se)


def test_an_se_of_a_task_that_gymnasium_does_not_know(tmp_path: Path) -> None:
    se = make_se(get_task("CartPole-v0"))
    unknown = type(se)(se.se, "Nowhere-v0", se.step_limit, se.solved_reward)
    save_se(unknown, tmp_path / "se.safetensors")
    assert load_se(tmp_path / "se.safetensors").task_id == "Nowhere-v0"
    result = run_bilevel("show", tmp_path / "se.safetensors", cwd=tmp_path)
    assert result.returncode == 2
    assert "unknown task 'Nowhere-v0'" in result.stderr

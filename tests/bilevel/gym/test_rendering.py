"""Pictures of an SE's states: those that the real task draws of the same states."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pygame
import pytest
from gymnasium.error import ResetNeeded

from bilevel import InvalidInput
from bilevel.gym.rendering import Renderer
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from bilevel.zoo import ENTRIES, env_id, zoo_file


@pytest.mark.parametrize("name", [*ENTRIES, "MountainCar-v0"])
def test_a_state_of_the_real_task_looks_as_there(name: str) -> None:
    task = get_task(name)
    real: Any = task.make(render_mode="rgb_array").unwrapped
    renderer = Renderer(task, "rgb_array")
    for seed in range(3):
        observation, _ = real.reset(seed=seed)
        np.testing.assert_array_equal(renderer.draw(observation), real.render())
        for action in (0, 1, 0, 0):
            observation, *_ = real.step(action)
        np.testing.assert_array_equal(renderer.draw(observation), real.render())


@pytest.mark.parametrize("name", ENTRIES)
def test_each_state_is_drawn(name: str) -> None:
    env = gymnasium.make(env_id(name), render_mode="rgb_array")
    task = load_se(zoo_file(name)).task()
    assert env.metadata["render_fps"] == task.make(render_mode="rgb_array").metadata["render_fps"]
    env.reset(seed=0)
    first = env.render()
    for _ in range(5):
        env.step(0)
    assert np.any(first != env.render())
    env.close()


def window() -> Any:
    """The pixels of the open window."""
    surface = pygame.display.get_surface()
    assert surface is not None
    return pygame.surfarray.array3d(surface)


def test_a_window_follows_the_episode(se_file: Path) -> None:
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=se_file, render_mode="human")
    with pytest.raises(ResetNeeded):
        env.unwrapped.render()
    seen = []
    env.reset(seed=0)
    for _ in range(5):
        seen.append(window())
        env.step(1)
    seen.append(window())
    assert np.any(seen[0] != seen[-1])
    env.close()


def test_a_mode_that_there_is_not() -> None:
    with pytest.raises(
        InvalidInput, match="unknown render mode 'ansi': allowed are human, rgb_array"
    ):
        Renderer(get_task("CartPole-v0"), "ansi")


class Hidden(gymnasium.Env[Any, Any]):
    """A task whose state is not what it draws."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    observation_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, **kwargs: Any) -> None:
        self.render_mode = kwargs.get("render_mode")

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        return np.zeros(2, np.float32), {}

    def render(self) -> Any:
        return np.zeros((4, 4, 3), np.uint8)


class Blind(Hidden):
    """A task without render modes."""

    def __init__(self) -> None:
        super().__init__()


@pytest.mark.parametrize("entry_point", [Hidden, Blind])
def test_a_task_that_cannot_draw_a_given_state(entry_point: Any) -> None:
    gymnasium.register("Hidden-v0", entry_point, reward_threshold=1.0, max_episode_steps=5)
    try:
        with pytest.raises(InvalidInput, match="Hidden-v0 cannot draw a given state"):
            Renderer(get_task("Hidden-v0"), "rgb_array")
    finally:
        del gymnasium.registry["Hidden-v0"]

"""The real task's renderer draws an SE's states."""

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
from tests.envs import CustomEnv, register_env


@pytest.mark.parametrize("name", [*ENTRIES, "MountainCar-v0"])
def test_states_look_like_in_the_real_task(name: str) -> None:
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
def test_images_change_with_the_state(name: str) -> None:
    env = gymnasium.make(env_id(name), render_mode="rgb_array")
    real = load_se(zoo_file(name)).task().make(render_mode="rgb_array")
    assert env.metadata["render_fps"] == real.metadata["render_fps"]
    env.reset(seed=0)
    first = env.render()
    for _ in range(5):
        env.step(0)
    assert np.any(first != env.render())
    env.close()


def test_the_window_shows_the_current_state(se_file: Path) -> None:
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=se_file, render_mode="human")
    with pytest.raises(ResetNeeded):
        env.unwrapped.render()
    env.reset(seed=0)
    images = []
    for _ in range(5):
        surface = pygame.display.get_surface()
        assert surface is not None
        images.append(pygame.surfarray.array3d(surface))
        env.step(1)
    assert np.any(images[0] != images[-1])
    env.close()


@pytest.mark.parametrize(
    ("entry_point", "mode", "message"),
    [
        (CustomEnv, "ansi", "unknown render mode 'ansi': allowed are human, rgb_array"),
        (CustomEnv, "rgb_array", "cannot draw a given state .*render_mode"),
        (lambda **_: CustomEnv(), "rgb_array", "cannot draw a given state$"),
    ],
)
def test_tasks_that_cannot_draw_a_given_state(
    entry_point: Any, mode: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They do not accept `render_mode`, or have no attribute `state`."""
    task = get_task(register_env(monkeypatch, entry_point))
    with pytest.raises(InvalidInput, match=message):
        Renderer(task, mode)

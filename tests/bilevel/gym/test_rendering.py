"""The real task's renderer draws an SE's states."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pygame
import pytest

from bilevel import InvalidInput
from bilevel.synthetic_env import save_se
from bilevel.tasks import BUILT_IN_TASKS, get_task
from tests.ses import make_se


@pytest.mark.parametrize("name", BUILT_IN_TASKS)
def test_states_look_like_in_the_real_task(name: str, tmp_path: Path) -> None:
    save_se(make_se(get_task(name)), tmp_path / "se")
    id_ = "bilevel/SyntheticEnv-v0"
    env: Any = gymnasium.make(id_, path=tmp_path / "se", render_mode="rgb_array").unwrapped
    env.action_space.seed(0)
    real: Any = get_task(name).make(render_mode="rgb_array").unwrapped
    assert env.metadata["render_fps"] == real.metadata["render_fps"]
    images = []
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(seed):
            state = env.step(env.action_space.sample())[0]
        images.append(env.render())
        if seed:
            real.reset()
            real.state = get_task(name).physics(state)
            np.testing.assert_array_equal(images[-1], real.render())
    assert np.any(images[0] != images[-1])
    env.close()


def test_the_window_shows_the_current_state(se_file: Path) -> None:
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=se_file, render_mode="human")
    env.reset(seed=0)
    images = []
    for _ in range(5):
        surface = pygame.display.get_surface()
        assert surface is not None
        images.append(pygame.surfarray.array3d(surface))
        env.step(1)
    assert np.any(images[0] != images[-1])
    env.close()


@pytest.mark.filterwarnings("ignore:.*render:UserWarning")
def test_unavailable_modes(se_file: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="mode 'ansi' is not available"):
        gymnasium.make("bilevel/SyntheticEnv-v0", path=se_file, render_mode="ansi")
    save_se(make_se(get_task("FrozenLake-v1")), tmp_path / "se")
    with pytest.raises(InvalidInput, match="is not available for FrozenLake-v1"):
        gymnasium.make("bilevel/SyntheticEnv-v0", path=tmp_path / "se", render_mode="rgb_array")

"""Errors and invalid values of users' environments raise UserCodeError in one line."""

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from bilevel.tasks import get_task
from bilevel.user_code import UserCodeError
from tests.envs import CustomEnv, register_env


def raise_error() -> Any:
    raise RuntimeError("the simulator\nbroke")


def returning(state: Any = (0.0, 0.0), reward: Any = -1.0) -> Callable[[], Any]:
    return lambda: (np.array(state, np.float32), reward, True, False, {})


@pytest.mark.parametrize(
    ("functions", "message"),
    [
        ({"step": raise_error}, r"adapter.py:\d+, when it takes a step: RuntimeError: the simul"),
        ({"step": lambda: (0, 1.0, True, {})}, "when it takes a step: ValueError: not enough"),
        (
            {"step": returning((np.nan, 0.0))},
            r"returns \[nan  0.\] and the reward -1.0",
        ),
        ({"step": returning((1.0, 2.0, 3.0))}, r"the shape \(3,\), not \(2,\)"),
        ({"step": returning(reward=np.inf)}, "the reward inf: not finite"),
        ({"step": returning(reward=None)}, "when it takes a step: TypeError"),
        ({"observe": lambda _: np.full(2, np.nan)}, "returns .nan nan."),
    ],
)
def test_invalid_values_are_reported_with_their_place(
    functions: Any, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = get_task(register_env(monkeypatch, lambda **_: CustomEnv(**functions)))
    with pytest.raises(UserCodeError, match=f"^task 'test/Custom-v0'.*{message}") as caught:
        task.try_out()
    assert "\n" not in str(caught.value)
    with pytest.raises(UserCodeError):
        task.observation_scale(0)


def test_valid_environments_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    for task_id in (register_env(monkeypatch, lambda **_: CustomEnv()), "CartPole-v0"):
        get_task(task_id).try_out()


def test_observations_are_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment may reuse its array for the next observation."""
    observation = np.zeros(2, np.float32)

    def step() -> Any:
        observation[:] += 1.0
        return observation, -1.0, False, False, {}

    env_id = register_env(monkeypatch, lambda **_: CustomEnv(lambda _: observation, step))
    with closing(get_task(env_id).real_env()) as env:
        states = [env.reset(seed=0), env.step(0)[0], env.step(0)[0]]
    assert [state[0] for state in states] == [0.0, 1.0, 2.0]


def test_only_user_code_has_a_digest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task_id = register_env(monkeypatch, CustomEnv)
    digest = get_task(task_id).code_digest
    assert digest is not None
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "registers_nothing.py").write_text("")
    assert get_task(f"registers_nothing:{task_id}").code_digest == digest
    assert get_task(register_env(monkeypatch, partial(CustomEnv))).code_digest == digest
    assert get_task("CartPole-v0").code_digest is None


def test_observations_that_float32_cannot_resolve(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(1_700_000_000, 1_800_000_000))
    space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float64)
    env = partial(CustomEnv, observe=lambda rng: np.array([0.5, next(clock)]), space=space)
    with pytest.raises(UserCodeError, match=r"observation 1 is near 1.7e.09 and changes by 1, whi"):
        get_task(register_env(monkeypatch, env)).try_out()
    env = partial(CustomEnv, observe=lambda rng: np.array([0.5, 1e39]), space=space)
    with pytest.raises(UserCodeError, match="not finite in float32"):
        get_task(register_env(monkeypatch, env)).try_out()
    assert get_task("MountainCar-v0").code_digest is None

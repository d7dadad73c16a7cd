"""Tasks given as text, specifications and functions."""

import types
from functools import partial
from typing import Any

import gymnasium
import pytest

from bilevel import InvalidInput, get_task
from bilevel.tasks import EnvSource
from tests.envs import CustomEnv


class Halved(gymnasium.RewardWrapper[Any, Any]):
    """Rewards are half as large."""

    def reward(self, reward: Any) -> float:
        return float(reward) / 2


HALVED = f"{__name__}:Halved"


@pytest.fixture(autouse=True)
def registry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gymnasium.envs.registration, "registry", gymnasium.registry.copy())
    monkeypatch.setattr(gymnasium, "registry", gymnasium.envs.registration.registry)


@pytest.mark.parametrize(
    ("text", "kwargs"),
    [
        ("a/B-v0", {}),
        ("my_package:B-v0,slippery=False", {"slippery": False}),
        ("B-v0,a=1,b=0.5,c=word,d=None", {"a": 1, "b": 0.5, "c": "word", "d": None}),
        ("B-v0,desc=['SF'%2C 'HG']", {"desc": ["SF", "HG"]}),
        ("B-v0,number='8'", {"number": "8"}),
    ],
)
@pytest.mark.parametrize("wrappers", [(), ("a.b:C", "d:E")])
def test_text_and_source_are_inverse(
    text: str, kwargs: dict[str, Any], wrappers: tuple[str, ...]
) -> None:
    env_id = text.split(",")[0]
    text += "".join(f",wrapper={wrapper}" for wrapper in wrappers)
    source = EnvSource(env_id, tuple(kwargs.items()), wrappers)
    assert EnvSource.parse(text) == EnvSource.of(env_id, kwargs, wrappers) == source
    assert str(source) == text


@pytest.mark.parametrize("text", ["T-v0,x", "T-v0,x=", "T-v0,a b=1", "T-v0,wrapper=NoModule"])
def test_invalid_text(text: str) -> None:
    with pytest.raises(InvalidInput, match=r"keyword argument|MODULE:CLASS"):
        EnvSource.parse(text)


def test_arguments_and_wrappers_reach_the_environment() -> None:
    task = get_task("FrozenLake-v1", env_kwargs={"is_slippery": False}, wrappers=[HALVED])
    assert task.id == f"FrozenLake-v1,is_slippery=False,wrapper={HALVED}"
    assert get_task(task.id) == task
    with task.shared_env() as env:
        env.reset(0)
        rewards = [env.step(action)[1] for action in (1, 1, 2, 1, 2, 2)]  # not slippery
    assert rewards == [0.0, 0.0, 0.0, 0.0, 0.0, 0.5]


def test_changed_dynamics_are_not_compiled() -> None:
    assert get_task("Acrobot-v1").compiled
    assert not get_task("Acrobot-v1", wrappers=[HALVED]).compiled


@pytest.mark.parametrize("kwargs", [{"x": object()}, {"x": {1, 2}.union}])
def test_arguments_must_have_a_text(kwargs: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput, match="must be numbers"):
        get_task("FrozenLake-v1", env_kwargs=kwargs)


def test_a_specification() -> None:
    """With its arguments, step limit and solved reward."""
    env = gymnasium.make("FrozenLake-v1", is_slippery=False, max_episode_steps=30)
    assert env.spec is not None
    task = get_task(env.spec)
    assert (task.id, task.step_limit) == ("FrozenLake-v1,is_slippery=False", 30)
    new = gymnasium.envs.registration.EnvSpec(
        "New-v0",
        entry_point=f"{CustomEnv.__module__}:CustomEnv",
        reward_threshold=1.0,
        max_episode_steps=9,
    )
    assert get_task(new) == get_task("New-v0")


def test_wrappers_of_a_specification_are_rejected() -> None:
    wrapped = gymnasium.wrappers.ClipReward(gymnasium.make("FrozenLake-v1"), 0, 1)
    assert wrapped.spec is not None
    with pytest.raises(InvalidInput, match="wrappers"):
        get_task(wrapped.spec)


LENGTH: dict[str, Any] = {"solved_reward": 1.0, "step_limit": 7}


def walk() -> CustomEnv:
    return CustomEnv()


def test_a_function_that_returns_an_environment() -> None:
    task = get_task(walk, **LENGTH)
    assert task == get_task(walk, **LENGTH) == get_task("walk-v0", **LENGTH)
    again = types.FunctionType(walk.__code__, globals(), "walk")  # as a notebook defines it again
    again.__qualname__ = "walk"
    assert get_task(again, **LENGTH) == task
    assert task.source.spec is not None
    assert task.source.spec.entry_point is again


def test_an_id_belongs_to_one_environment() -> None:
    """Otherwise an earlier task would have the environment of a later one."""
    for one, other in (
        (lambda: CustomEnv(), lambda: CustomEnv()),
        (partial(walk), partial(walk)),
        (walk, type("walk", (CustomEnv,), {"__qualname__": "walk", "__module__": "other"})),
    ):
        get_task(one, **LENGTH)
        with pytest.raises(InvalidInput, match="belongs to another environment"):
            get_task(other, **LENGTH)

"""Real tasks of users' own: their mistakes are told in one line, and never become scores."""

from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from bilevel.errors import InvalidInput
from bilevel.tasks import get_task
from bilevel.user_code import Mistake

NAME = "Broken-v0"


class Broken(gymnasium.Env[Any, Any]):
    """A task that is sound but for what a test replaces."""

    observation_space = gymnasium.spaces.Box(-9, 9, (2,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, **kwargs: Any) -> None:
        self._step = kwargs.get("step")
        self._first = kwargs.get("first", np.zeros(2, np.float32))
        self._close = kwargs.get("close")

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        return self._first, {}

    def step(self, action: Any) -> Any:
        if self._step is not None:
            return self._step()
        return np.zeros(2, np.float32), -1.0, True, False, {}

    def close(self) -> None:
        if self._close is not None:
            self._close()


@pytest.fixture
def register() -> Iterator[Callable[..., None]]:
    def one(**kwargs: Any) -> None:
        gymnasium.register(NAME, Broken, max_episode_steps=10, reward_threshold=-5.0, kwargs=kwargs)

    yield one
    gymnasium.registry.pop(NAME, None)


def raises() -> Any:
    raise RuntimeError("the simulator\nbroke")


def returned(state: Any = (0.0, 0.0), reward: Any = -1.0) -> Callable[[], Any]:
    return lambda: (np.array(state, np.float32), reward, True, False, {})


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::DeprecationWarning")  # of gymnasium
@pytest.mark.parametrize(
    ("kwargs", "told"),
    [
        ({"step": raises}, r"test_checked.py:\d+, when it takes a step: RuntimeError: the simul"),
        ({"step": lambda: (0, 1.0, True, {})}, "when it takes a step: ValueError: not enough"),
        ({"step": returned((np.nan, 0.0))}, r"test_checked.py:\d+: an observation is \[nan  0.\]"),
        ({"step": returned((1.0, 2.0, 3.0))}, r"has the shape \(3,\): its space has \(2,\)"),
        ({"step": returned(reward=np.inf)}, "the reward is inf: it must be finite"),
        ({"step": returned(reward="1")}, "the reward is .1.: no number"),
        ({"step": returned(reward=None)}, "when it takes a step: TypeError"),
        ({"first": np.full(2, np.nan)}, "an observation is .nan nan.: it must be finite"),
        ({"first": np.zeros((2, 1))}, r"has the shape \(2, 1\)"),
    ],
)
def test_a_mistake_is_told_with_its_place(
    kwargs: Any, told: str, register: Callable[..., None]
) -> None:
    register(**kwargs)
    task = get_task(NAME)
    with pytest.raises(Mistake, match=f"^task 'Broken-v0'.*{told}") as caught:
        task.try_out()
    assert "\n" not in str(caught.value)
    with pytest.raises(Mistake):
        task.observation_scale(0)


def test_a_task_that_cannot_be_closed_is_told(register: Callable[..., None]) -> None:
    register(close=raises)
    with pytest.raises(Mistake, match=r"^task 'Broken-v0'.*, when it is closed: RuntimeError: the"):
        get_task(NAME)


@pytest.mark.parametrize("closing_fails", [RuntimeError("a consequence"), SystemExit("no server")])
@pytest.mark.parametrize("cause", [ValueError("the cause"), KeyboardInterrupt("the cause")])
def test_the_first_error_is_told(
    cause: BaseException, closing_fails: BaseException, register: Callable[..., None]
) -> None:
    """A task that fails before it has made what it closes fails again when it is closed."""
    failed: list[bool] = []

    def step() -> Any:
        failed.append(True)
        raise cause

    def close() -> None:
        if failed:
            raise closing_fails

    register(step=step, close=close)
    interrupted = isinstance(cause, KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt if interrupted else Mistake, match="the cause"):
        get_task(NAME).try_out()


def test_a_sound_task_is_tried_out(register: Callable[..., None]) -> None:
    register()
    get_task(NAME).try_out()
    get_task("CartPole-v0").try_out()


def test_without_components_there_is_nothing_to_observe(
    register: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Broken, "observation_space", gymnasium.spaces.Box(-1, 1, (0,)))
    register()
    with pytest.raises(InvalidInput, match="observations without components"):
        get_task(NAME)


@pytest.mark.filterwarnings("ignore:.*share an object:UserWarning")  # of gymnasium
def test_an_observation_is_kept_if_the_task_writes_the_next_one_over_it(
    register: Callable[..., None],
) -> None:
    observation = np.zeros(2, np.float32)

    def step() -> Any:
        observation[:] += 1.0
        return observation, -1.0, False, False, {}

    register(first=observation, step=step)
    with closing(get_task(NAME).make()) as env:
        states = [env.reset(seed=0)[0], env.step(np.int64(0))[0], env.step(np.int64(0))[0]]
    assert [state[0] for state in states] == [0.0, 1.0, 2.0]


def test_only_code_of_the_users_own_has_a_digest(
    register: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of a task whose id names its module."""
    register()
    digest = get_task(NAME).code_digest
    assert digest is not None
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "registers_nothing.py").write_text("")
    assert get_task(f"registers_nothing:{NAME}").code_digest == digest
    for number, entry in enumerate((partial(Broken, first=np.ones(2)), lambda **_: Broken())):
        name = f"Other{number}-v0"
        gymnasium.register(name, entry, max_episode_steps=10, reward_threshold=-5.0)  # type: ignore[arg-type]
        assert get_task(name).code_digest == digest
        gymnasium.registry.pop(name)
    assert get_task("CartPole-v0").code_digest is None
    assert get_task("MountainCar-v0").code_digest is None

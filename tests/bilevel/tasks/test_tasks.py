import re
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

from bilevel import InvalidInput
from bilevel.evaluation import train_and_test
from bilevel.evaluation.run import greedy_episodes
from bilevel.hyperparameters import load_recipe
from bilevel.tasks import BUILT_IN_TASKS, Task, get_task
from bilevel.user_code import Mistake


def test_papers_fixed_values() -> None:
    cartpole, acrobot = get_task("CartPole-v0"), get_task("Acrobot-v1")
    assert (cartpole.step_limit, cartpole.solved_reward) == (200, 195.0)
    assert (acrobot.step_limit, acrobot.solved_reward) == (500, -100.0)
    for task in (cartpole, acrobot):
        env = task.make()
        assert env.observation_space.shape == (task.state_size,)
        assert env.spec is not None
        assert env.spec.reward_threshold == task.solved_reward
        assert env.spec.max_episode_steps == task.step_limit


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_an_observation_gives_the_simulators_state(task_id: str) -> None:
    task = get_task(task_id)
    for physics in task.initial_physics(np.random.default_rng(1), 5):
        np.testing.assert_allclose(task.physics(task.observe(physics)), physics, atol=1e-6)


def test_any_suitable_gymnasium_id() -> None:
    task = get_task("MountainCar-v0")
    assert task == Task("MountainCar-v0", 2, 3, 200, -110.0, -200.0)
    assert not task.compiled
    states = task.initial_physics(np.random.default_rng(0), 1000)
    assert states.shape == (200, 2)
    np.testing.assert_array_equal(states, task.initial_physics(np.random.default_rng(0), 1000))


@pytest.mark.parametrize(
    ("solved", "worst"), [(-110.0, -200.0), (-200.0, -400.0), (-300.0, -600.0)]
)
def test_the_worst_score_is_below_the_solved_one(solved: float, worst: float) -> None:
    """Also of a task that takes more than 1 a step: progress is measured from one to the other."""
    assert get_task("MountainCar-v0", solved_reward=solved).worst_score == worst


@pytest.mark.parametrize("worst", [-110.0, 0.0, -np.inf, np.nan])
def test_a_worst_score_that_is_none(worst: float) -> None:
    with pytest.raises(InvalidInput, match=r"--worst-score.* below the solved reward, -110; got"):
        get_task("MountainCar-v0", worst_score=worst)


def test_given_values_come_first() -> None:
    cartpole = BUILT_IN_TASKS["CartPole-v0"]
    assert get_task("CartPole-v0", worst_score=8.5) == replace(cartpole, worst_score=8.5)
    task = get_task("CartPole-v1", solved_reward=150.0, step_limit=70)
    assert (task.solved_reward, task.step_limit) == (150.0, 70)
    lengths = [len(episode) for episode in greedy_episodes(task, lambda state: 0, 3, seed=1)]
    assert len(lengths) == 3
    assert max(lengths) <= 70


@pytest.mark.parametrize(
    ("task_id", "message"),
    [
        ("CartPole-v99", "unknown task 'CartPole-v99'"),
        ("nonsense", "unknown task 'nonsense'"),
        ("Pendulum-v1", "has actions Box"),
        ("MountainCarContinuous-v0", "allowed is Discrete"),
        ("Taxi-v4", "allowed is a Box"),
    ],
)
def test_unsuitable(task_id: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message) as error:
        get_task(task_id)
    assert "\n" not in str(error.value)


def test_actions_that_do_not_start_at_zero() -> None:
    class Shifted(gymnasium.Wrapper[Any, Any, Any, Any]):
        def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
            super().__init__(env)
            self.action_space = gymnasium.spaces.Discrete(2, start=5)

        def step(self, action):  # type: ignore[no-untyped-def]
            assert self.action_space.contains(np.int64(action))
            return self.env.step(action - 5)

    def make(**kwargs: Any) -> gymnasium.Env[Any, Any]:
        return Shifted(gymnasium.make("CartPole-v1"))

    gymnasium.register("test/Shifted-v0", make)
    try:
        task = get_task("test/Shifted-v0", solved_reward=100.0, step_limit=20)
        (episode,) = greedy_episodes(task, lambda state: 1, 1, seed=0)
        assert len(episode) > 1
    finally:
        del gymnasium.registry["test/Shifted-v0"]


def test_what_training_and_tests_open_they_close() -> None:
    """A simulator may be a process, or hold a socket."""
    opened: list[gymnasium.Env[Any, Any]] = []
    closed: list[gymnasium.Env[Any, Any]] = []

    class Counted(gymnasium.Wrapper[Any, Any, Any, Any]):
        def close(self) -> None:
            closed.append(self)

    def make(**kwargs: Any) -> gymnasium.Env[Any, Any]:
        opened.append(Counted(gymnasium.make("CartPole-v1")))
        return opened[-1]

    gymnasium.register("test/Counted-v0", make)
    try:
        task = get_task("test/Counted-v0", solved_reward=100.0, step_limit=20)
        opened.clear()
        closed.clear()
        agent = replace(load_recipe("paper", "").agents[0], max_episodes=2)
        outcome = train_and_test(task, None, agent, 0)
        assert outcome.train_episodes == 2
        # one for training, one for tests
        assert len(opened) == len(closed) == len(set(closed)) == 2
    finally:
        del gymnasium.registry["test/Counted-v0"]


class Constant(gymnasium.Env[Any, Any]):
    """The observation is a random number, and one that never changes."""

    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, dtype: Any, value: float) -> None:
        self.observation_space = gymnasium.spaces.Box(-20.0, 20.0, (2,), dtype)
        self.value = value

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        return self._observation(), {}

    def step(self, action: Any) -> Any:
        return self._observation(), 1.0, False, False, {}

    def _observation(self) -> Any:
        values = [self.np_random.normal(), self.value]
        return np.array(values, self.observation_space.dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("value", [0.0, 0.1, 9.8, -0.3])
def test_a_constant_observation_has_the_deviation_one(
    dtype: Any, value: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its computed deviation is not 0: 1e-14 in float64, up to 1e-3 in float32."""
    spec = gymnasium.envs.registration.EnvSpec(
        "test/Constant-v0",
        entry_point=lambda **_: Constant(dtype, value),
        reward_threshold=1.0,
        max_episode_steps=10,
    )
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    scale = get_task(spec.id).observation_scale(seed=0)
    assert scale.deviation[1] == 1.0
    assert 0.8 < scale.deviation[0] < 1.2
    assert scale.mean[1] == pytest.approx(value, abs=1e-2)


@pytest.mark.parametrize(
    "error", [ValueError(), KeyError("weights"), RuntimeError("no\nlicence"), SystemExit("no key")]
)
def test_a_task_whose_constructor_fails_is_told_in_a_line(
    error: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: Any) -> Any:
        raise error

    spec = gymnasium.envs.registration.EnvSpec("test/Broken-v0", entry_point=fail)
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    place = rf"{re.escape(__file__)}:\d+"
    with pytest.raises(Mistake, match=rf"^task 'test/Broken-v0' at {place}, when it is made: .*$"):
        get_task(spec.id)


def test_what_a_task_does_not_name_is_asked_for_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = gymnasium.envs.registration.EnvSpec(
        "test/Constant-v0", entry_point=lambda **_: Constant(np.float32, 1.0)
    )
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    told = (
        "test/Constant-v0 names no solved reward and no step limit: give --solved-reward and "
        "--step-limit, in Python bilevel.get_task('test/Constant-v0', solved_reward=..., "
        "step_limit=...)"
    )
    with pytest.raises(InvalidInput, match=f"^{re.escape(told)}$"):
        get_task(spec.id)
    with pytest.raises(InvalidInput, match=r"-limit, .* solved_reward=1.0, step_limit=\.\.\.\)$"):
        get_task(spec.id, solved_reward=1.0)
    task = get_task(spec.id, solved_reward=1.0, step_limit=9)
    assert (task.solved_reward, task.step_limit) == (1.0, 9)


def test_a_module_that_is_not_found() -> None:
    with pytest.raises(InvalidInput, match=r"needs the module 'nowhere', .* must be on PYTHONPATH"):
        get_task("nowhere:Mine-v0")


def test_a_task_that_lacks_a_module_or_a_space_says_where(monkeypatch: pytest.MonkeyPatch) -> None:
    class Lacking(gymnasium.Env[Any, Any]):
        pass

    def imports(**_: Any) -> Any:
        import not_there  # type: ignore[import-not-found]

        return not_there

    for entry, told in ((Lacking, "its spaces: Attr"), (imports, r"made: Mod.*'not_there'")):
        made: Any = entry
        spec = gymnasium.envs.registration.EnvSpec("test/Lacking-v0", entry_point=made)
        monkeypatch.setitem(gymnasium.registry, spec.id, spec)
        with pytest.raises(Mistake, match=rf"^task '{spec.id}' at {re.escape(__file__)}:.*{told}"):
            get_task(spec.id)


def test_gymnasiums_warnings_come_once(
    monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
) -> None:
    """Not for every environment that is made in training and tests."""

    class Double(Constant):
        def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
            state, info = super().reset(**options)
            return state.astype(np.float64), info

    spec = gymnasium.envs.registration.EnvSpec(
        "test/Double-v0",
        entry_point=lambda **_: Double(np.float32, 1.0),
        reward_threshold=1.0,
        max_episode_steps=10,
    )
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    task = get_task(spec.id)
    task.observation_scale(0)
    assert not recwarn
    task.try_out()
    assert recwarn

import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from bilevel import NES, InvalidInput
from bilevel.evaluation import evaluate, train_and_test
from bilevel.evaluation.run import greedy_episodes
from bilevel.recipes import load_recipe
from bilevel.tasks import BUILT_IN_TASKS, RealEnv, Task, get_task
from bilevel.user_code import UserCodeError
from tests.envs import CustomEnv, ShiftedCartPole, register_env


@pytest.mark.parametrize(
    ("task_id", "step_limit", "solved_reward"),
    [("CartPole-v0", 200, 195.0), ("Acrobot-v1", 500, -100.0)],
)
def test_fixed_values_of_the_paper(task_id: str, step_limit: int, solved_reward: float) -> None:
    task = get_task(task_id)
    assert (task.step_limit, task.solved_reward) == (step_limit, solved_reward)
    env = task.make()
    assert env.spec is not None
    assert env.observation_space.shape == (task.state_size,)
    assert (env.spec.max_episode_steps, env.spec.reward_threshold) == (step_limit, solved_reward)


@pytest.mark.parametrize("task_id", BUILT_IN_TASKS)
def test_physics_inverts_observe(task_id: str) -> None:
    task = get_task(task_id)
    for physics in task.initial_physics(np.random.default_rng(1), 5):
        np.testing.assert_allclose(task.physics(task.observe(physics)), physics, atol=1e-6)


def test_a_task_of_gymnasium() -> None:
    task = get_task("FrozenLake-v1")
    assert task == Task("FrozenLake-v1", 16, 4, 100, 0.7, 0.0)
    assert not task.compiled
    states = task.initial_physics(np.random.default_rng(0), 1000)
    assert states.shape == (200, 16)
    np.testing.assert_array_equal(states, task.initial_physics(np.random.default_rng(0), 1000))


@pytest.mark.parametrize(
    ("solved", "worst"), [(-110.0, -200.0), (-200.0, -400.0), (-300.0, -600.0), (5.0, 0.0)]
)
def test_default_worst_score_is_below_the_solved_reward(solved: float, worst: float) -> None:
    assert get_task("MountainCar-v0", solved_reward=solved).worst_score == worst


def test_arguments_replace_values() -> None:
    cartpole = BUILT_IN_TASKS["CartPole-v0"]
    assert get_task("CartPole-v0", worst_score=8.5) == replace(cartpole, worst_score=8.5)
    task = get_task("CartPole-v1", solved_reward=150.0, step_limit=70)
    assert (task.solved_reward, task.step_limit) == (150.0, 70)
    lengths = [len(episode) for episode in greedy_episodes(task, lambda state: 0, 3, seed=1)]
    assert len(lengths) == 3
    assert max(lengths) <= 70


@pytest.mark.parametrize(
    ("task_id", "values", "message"),
    [
        ("CartPole-v99", {}, "unknown task 'CartPole-v99'"),
        ("nonsense", {}, "unknown task 'nonsense'"),
        ("CartPole", {}, "task 'CartPole' has no version, such as CartPole-v1"),
        ("nowhere:Mine-v0", {}, "No module named 'nowhere'"),
        ("CliffWalking-v1", {}, "does not specify its solved reward"),
        ("CartPole-v0", {"solved_reward": "9"}, "solved reward must be a finite number; got '9'"),
        ("CartPole-v0", {"step_limit": 0}, "must be 1 to 1000000; got 0"),
        ("CartPole-v0", {"worst_score": "9"}, "worst score must be finite and below"),
        *(
            ("MountainCar-v0", {"worst_score": worst}, "below the solved reward, -110; got")
            for worst in (-110.0, 0.0, -np.inf, np.nan)
        ),
    ],
)
def test_invalid_tasks(task_id: str, values: Any, message: str) -> None:
    with pytest.raises(InvalidInput, match=message) as error:
        get_task(task_id, **values)
    assert "\n" not in str(error.value)


def test_missing_values_are_required(monkeypatch: pytest.MonkeyPatch) -> None:
    name = register_env(monkeypatch, CustomEnv, reward_threshold=None, max_episode_steps=None)
    with pytest.raises(InvalidInput, match="does not specify its solved reward: give --solved-rew"):
        get_task(name)
    with pytest.raises(InvalidInput, match="does not specify its step limit: give --step-limit"):
        get_task(name, solved_reward=1.0)
    task = get_task(name, solved_reward=1.0, step_limit=9)
    assert (task.solved_reward, task.step_limit) == (1.0, 9)


@pytest.mark.parametrize("error", [KeyError("weights"), RuntimeError("no\nlicence"), SystemExit()])
def test_errors_of_a_constructor_are_reported_with_their_place(
    error: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: Any) -> Any:
        raise error

    place = rf"{re.escape(__file__)}:\d+"
    with pytest.raises(UserCodeError, match=rf"^task .* at {place}, when it is created: .*$"):
        get_task(register_env(monkeypatch, fail))


def test_actions_need_not_start_at_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    task = get_task(register_env(monkeypatch, ShiftedCartPole))
    (episode,) = greedy_episodes(task, lambda state: 1, 1, seed=0)
    assert len(episode) > 1


def test_a_process_opens_the_environment_of_a_task_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some simulators start slowly, are processes, or hold sockets."""
    opened, closed = list[int](), list[int]()

    def env(**_: Any) -> CustomEnv:
        opened.append(1)
        return CustomEnv(close=lambda: closed.append(1))

    task = get_task(register_env(monkeypatch, env))
    opened.clear()
    closed.clear()
    agent = replace(load_recipe("paper", "").agents[0], max_episodes=2)
    for seed in range(2):
        assert train_and_test(task, None, agent, seed).train_episodes == 2
    assert (len(opened), len(closed)) == (1, 0)
    with pytest.raises(KeyboardInterrupt), task.shared_env():
        raise KeyboardInterrupt
    assert (len(opened), len(closed)) == (1, 1)  # it may be in any state

    def shared() -> RealEnv:
        with task.shared_env() as env:
            return env

    assert shared() is shared()
    with ThreadPoolExecutor() as threads:
        assert threads.submit(shared).result() is not shared()
    with get_task("FrozenLake-v1").shared_env():
        assert len(closed) == 2


@pytest.mark.parametrize("value", [0.0, 9.8])
def test_a_constant_observation_has_the_deviation_one(
    value: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its computed deviation is not 0: up to 1e-3 in float32."""
    env = partial(CustomEnv, observe=lambda rng: np.array([rng.normal(), value], np.float32))
    scale = get_task(register_env(monkeypatch, env)).observation_scale(seed=0)
    assert scale.deviation[1] == 1.0
    assert 0.8 < scale.deviation[0] < 1.2
    assert scale.mean[1] == pytest.approx(value, abs=1e-2)


def test_labels_have_the_sizes_of_the_task() -> None:
    for name in (*BUILT_IN_TASKS, "FrozenLake-v1"):
        task = get_task(name)
        labels = task.labels
        assert len(set(labels.observations)) == task.state_size > max(labels.axes)
        assert len(set(labels.actions)) == task.action_size


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("gymnasium.envs.box2d")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "Box2D", None)
    with pytest.raises(
        InvalidInput, match=r'^LunarLander-v3 needs the extra box2d: pip install "\.'
    ):
        get_task("LunarLander-v3")


def test_a_mujoco_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log there
    task = get_task("Swimmer-v5", solved_reward=330, step_limit=50)
    assert (task.state_size, task.action_size, task.continuous) == (8, 2, True)
    task.try_out()
    hp = load_recipe("default", task)
    small = replace(hp.agents[0], max_episodes=320)
    nes = replace(hp.nes, start_candidates=2, population_size=1, centre_agents=1, generations=1)
    run = NES(task, replace(hp, nes=nes, agents=(small,)), seed=3)
    scores = []
    for _ in range(2):
        state = run.run(lambda ses, requests: [evaluate(task, ses, r) for r in requests])
        scores.append(state.records[-1].score_mean)
    assert scores[0] == scores[1] != 0


def test_changed_dynamics_are_not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = gymnasium.spec("Pendulum-v1")
    entry: Any = spec.entry_point
    for kwargs, compiled in (({}, True), ({"g": 9.81}, False)):
        name = register_env(monkeypatch, entry, kwargs=kwargs, max_episode_steps=200)
        assert get_task(name).compiled == compiled

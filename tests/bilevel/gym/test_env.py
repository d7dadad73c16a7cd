"""An SE as a gymnasium environment."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import mlflow
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from bilevel import InvalidInput
from bilevel.synthetic_env import SE, load_se, save_se
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import Task, get_task
from bilevel.zoo import ENTRIES, env_id
from tests.envs import ShiftedCartPole, register_env
from tests.ses import make_se

ENV = "bilevel/SyntheticEnv-v0"


@pytest.mark.filterwarnings("ignore:.*Box observation space.*infinity:UserWarning")
@pytest.mark.parametrize("name", [None, *ENTRIES])
def test_passes_the_environment_checker_of_gymnasium(name: str | None, se_file: Path) -> None:
    env = gymnasium.make(env_id(name)) if name else gymnasium.make(ENV, path=se_file)
    check_env(env.unwrapped)


def test_step_needs_reset(se_file: Path) -> None:
    many: Any = gymnasium.make_vec(ENV, num_envs=2, path=se_file)
    for env, action in ((gymnasium.make(ENV, path=se_file).unwrapped, 0), (many, [0, 0])):
        with pytest.raises(ResetNeeded):
            env.step(action)


def test_path_is_required() -> None:
    with pytest.raises(InvalidInput, match="path is missing"):
        gymnasium.make(ENV)


def test_an_se_in_mlflow(se_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The address is an artifact, or a folder with one SE."""
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/mlflow.db")
    client = mlflow.MlflowClient()
    experiment = client.create_experiment("ses", artifact_location=str(tmp_path / "artifacts"))
    run = client.create_run(experiment).info.run_id
    client.log_artifact(run, str(se_file), "model/data")
    for address in (f"runs:/{run}/model", f"runs:/{run}/model/data/se.safetensors"):
        env: Any = gymnasium.make(ENV, path=address).unwrapped
        np.testing.assert_array_equal(env.se.psi, load_se(se_file).psi)
    for address in (f"runs:/{run}/nothing", "models:/none@best"):
        with pytest.raises(InvalidInput, match=r"^MLflow has no SE at [^\n]*$"):
            gymnasium.make(ENV, path=address)


def test_mlflow_must_be_configured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise MLflow would create an empty database in the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    with pytest.raises(InvalidInput, match="needs MLflow: set MLFLOW_TRACKING_URI"):
        gymnasium.make(ENV, path="models:/SE-CartPole-v0@best")
    assert not list(tmp_path.iterdir())


def test_steps_follow_the_se(se_file: Path) -> None:
    env, module = gymnasium.make(ENV, path=se_file), SEModule(load_se(se_file))
    state, _ = env.reset(seed=1)
    assert abs(state).max() <= 0.05  # CartPole's reset distribution
    for t in range(1, 201):
        expected, reward, _ = module(torch.from_numpy(state), torch.tensor(t % 2))
        state, got_reward, terminated, truncated, info = env.step(np.int64(t % 2))
        np.testing.assert_allclose(state, expected, rtol=1e-4, atol=1e-5)
        assert got_reward == pytest.approx(float(reward), rel=1e-3, abs=1e-4)
        assert terminated == (info["done"] > 0.5)
        assert truncated == (t == 200)
        if terminated:
            break


def test_episodes_are_truncated_at_the_step_limit_of_the_se(cartpole: Task, tmp_path: Path) -> None:
    se = make_se(cartpole)
    short = replace(se.architecture, step_limit=4)
    psi = np.zeros(short.parameter_count, np.float32)  # never terminates
    save_se(replace(se, se=SE(short, psi)), tmp_path / "short.safetensors")
    env = gymnasium.make(ENV, path=tmp_path / "short.safetensors")
    env.reset(seed=1)
    ends = [env.step(np.int64(0))[2:4] for _ in range(4)]
    assert ends == [(False, False)] * 3 + [(False, True)]


def test_initial_states_and_actions_of_a_task_in_gymnasium(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real environment is created once."""
    made = []

    def make(**_: Any) -> ShiftedCartPole:
        made.append(ShiftedCartPole())
        return made[-1]

    save_se(make_se(get_task(register_env(monkeypatch, make))), tmp_path / "se")
    env = gymnasium.make(ENV, path=tmp_path / "se")
    many: Any = gymnasium.make_vec(ENV, num_envs=2, path=tmp_path / "se")
    assert env.action_space == gymnasium.spaces.Discrete(2, start=5)
    assert many.single_action_space == env.action_space
    before = len(made)
    env.reset(seed=0)
    assert len({env.reset()[0].tobytes() for _ in range(3)}) == 3
    assert len(made) == before
    env.step(6)
    many.reset(seed=0)
    many.step(np.array([5, 6]))
    for wrong in (0, 4, 7):
        for take in (env.unwrapped.step, lambda action: many.step([5, action])):
            with pytest.raises(InvalidInput, match=r"are 5 to 6|must be 2 elements of Discrete"):
                take(wrong)

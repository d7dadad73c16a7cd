"""An SE as gymnasium's environment: gymnasium's own rules, and what the SE says."""

import sys
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
from tests.ses import make_se


def test_an_action_that_it_does_not_have_is_refused(se_file: Path) -> None:
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=se_file).unwrapped
    env.reset(seed=0)
    with pytest.raises(
        InvalidInput, match="action 2 is not allowed: allowed are the integers 0 to 1"
    ):
        env.step(2)


@pytest.mark.filterwarnings("ignore:.*Box observation space.*infinity:UserWarning")
@pytest.mark.parametrize("name", [None, *ENTRIES])
def test_passes_gymnasiums_own_check(name: str | None, se_file: Path) -> None:
    if name is None:
        env = gymnasium.make("bilevel/SyntheticEnv-v0", path=se_file)
    else:
        env = gymnasium.make(env_id(name))
    check_env(env.unwrapped)


def test_step_comes_after_reset(se_file: Path) -> None:
    single = gymnasium.make("bilevel/SyntheticEnv-v0", path=se_file)
    many: Any = gymnasium.make_vec("bilevel/SyntheticEnv-v0", num_envs=2, path=se_file)
    for env, action in ((single, 0), (single.unwrapped, 0), (many, [0, 0])):
        with pytest.raises(ResetNeeded):
            env.step(action)


def test_an_se_in_mlflow(se_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the address of a run's artifact, or of a folder that holds one SE."""
    uri = f"sqlite:///{tmp_path}/mlflow.db"
    client = mlflow.MlflowClient(uri)
    experiment = client.create_experiment("ses", artifact_location=str(tmp_path / "artifacts"))
    run = client.create_run(experiment).info.run_id
    client.log_artifact(run, str(se_file), "model/data")
    monkeypatch.setattr("mlflow.tracking._tracking_service.utils._tracking_uri", uri)
    for address in (f"runs:/{run}/model", f"runs:/{run}/model/data/se.safetensors"):
        env: Any = gymnasium.make("bilevel/SyntheticEnv-v0", path=address).unwrapped
        np.testing.assert_array_equal(env.se.psi, load_se(se_file).psi)
    for address in (f"runs:/{run}/nothing", "models:/none@best"):
        with pytest.raises(InvalidInput, match=r"^MLflow has no SE at [^\n]*$"):
            gymnasium.make("bilevel/SyntheticEnv-v0", path=address)
    client.log_artifact(run, str(se_file), "two")
    other = tmp_path / "other.safetensors"
    other.write_bytes(se_file.read_bytes())
    client.log_artifact(run, str(other), "two")
    with pytest.raises(InvalidInput, match="holds 2 SE files: give the address of one"):
        gymnasium.make("bilevel/SyntheticEnv-v0", path=f"runs:/{run}/two")


def test_mlflow_must_have_been_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else MLflow would make an empty database here, and find nothing in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.setattr("mlflow.tracking._tracking_service.utils._tracking_uri", None)
    with pytest.raises(InvalidInput, match="needs an MLflow: set MLFLOW_TRACKING_URI"):
        gymnasium.make("bilevel/SyntheticEnv-v0", path="models:/SE-CartPole-v0@best")
    assert not list(tmp_path.iterdir())


def test_a_module_that_a_file_names_is_not_imported(tmp_path: Path) -> None:
    (tmp_path / "bomb_of_an_se.py").write_text("raise SystemExit('executed')")
    se = replace(make_se(get_task("CartPole-v0")), task_id="bomb_of_an_se:Bomb-v0")
    save_se(se, tmp_path / "se.safetensors")
    sys.path.insert(0, str(tmp_path))
    try:
        with pytest.raises(InvalidInput, match=r"module 'bomb_of_an_se'.* is not imported"):
            gymnasium.make("bilevel/SyntheticEnv-v0", path=tmp_path / "se.safetensors")
    finally:
        sys.path.remove(str(tmp_path))
    assert "bomb_of_an_se" not in sys.modules


def test_follows_the_se(se_file: Path) -> None:
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=se_file)
    module = SEModule(load_se(se_file))
    state, _ = env.reset(seed=1)
    assert abs(state).max() <= 0.05  # CartPole's reset distribution
    for t in range(1, 201):
        expected, reward, done = module(torch.from_numpy(state), torch.tensor(t % 2))
        state, got_reward, terminated, truncated, info = env.step(np.int64(t % 2))
        np.testing.assert_allclose(state, expected, rtol=1e-4, atol=1e-5)
        assert got_reward == pytest.approx(float(reward), rel=1e-3, abs=1e-4)
        assert terminated == (info["done"] > 0.5)
        assert truncated == (t == 200)
        if terminated:
            break
    assert done is not None


def test_its_episodes_may_be_shorter_than_the_tasks(cartpole: Task, tmp_path: Path) -> None:
    se = make_se(cartpole)
    short = replace(se.architecture, step_limit=4)
    psi = np.zeros(short.parameter_count, np.float32)  # nothing ever ends
    save_se(replace(se, se=SE(short, psi)), tmp_path / "short.safetensors")
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=tmp_path / "short.safetensors")
    env.reset(seed=1)
    ends = [env.step(np.int64(0))[2:4] for _ in range(4)]
    assert ends == [(False, False)] * 3 + [(False, True)]


def test_a_task_in_gymnasium_is_made_once_and_keeps_its_actions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    class Shifted(gymnasium.Wrapper[Any, Any, Any, Any]):
        def __init__(self) -> None:
            super().__init__(gymnasium.make("CartPole-v1"))
            self.action_space = gymnasium.spaces.Discrete(2, start=5)
            made.append(self)

    spec = gymnasium.envs.registration.EnvSpec(
        "test/Shifted-v0",
        entry_point=lambda **_: Shifted(),
        reward_threshold=99.0,
        max_episode_steps=50,
    )
    monkeypatch.setitem(gymnasium.registry, spec.id, spec)
    save_se(make_se(get_task(spec.id)), tmp_path / "se")
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=tmp_path / "se")
    many: Any = gymnasium.make_vec("bilevel/SyntheticEnv-v0", num_envs=2, path=tmp_path / "se")
    assert env.action_space == gymnasium.spaces.Discrete(2, start=5)
    assert many.single_action_space == env.action_space
    before = len(made)
    env.reset(seed=0)
    first = [env.reset()[0] for _ in range(3)]
    assert len(made) == before
    assert len({state.tobytes() for state in first}) == 3
    env.step(6)
    many.reset(seed=0)
    many.step(np.array([5, 6]))
    for wrong in (0, 4, 7):
        with pytest.raises(InvalidInput, match="allowed are the integers 5 to 6"):
            env.unwrapped.step(wrong)
        with pytest.raises(InvalidInput, match="allowed are the integers 5 to 6"):
            many.step([5, wrong])

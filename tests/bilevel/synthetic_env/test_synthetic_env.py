import contextlib
import importlib
import json
import pickle
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import safetensors.numpy
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors import safe_open

from bilevel import InvalidInput
from bilevel.hyperparameters import ACTIVATIONS
from bilevel.kernels.synthetic_env import step
from bilevel.synthetic_env import SE, load_se, save_se, se_bytes
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import Task, get_task
from bilevel.zoo import ENTRIES, env_id, zoo_file
from tests.documents import documented_code
from tests.ses import make_se


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("layers", [1, 2])
@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1"])
def test_torch_module_gives_the_same_outputs(task_id: str, layers: int, activation: str) -> None:
    task = get_task(task_id)
    se = make_se(task, layers, activation)
    kernel, module = se.se.kernel, SEModule(se)
    rng = np.random.default_rng(2)
    states = rng.normal(0, 1, (20, task.state_size)).astype(np.float32)
    actions = rng.integers(0, task.n_actions, 20)
    next_states, rewards, dones = module(torch.from_numpy(states), torch.from_numpy(actions))
    work = np.zeros((2, 3 * 12), np.float32)
    out = np.zeros(task.state_size, np.float32)
    for i in range(20):
        reward, done = step(kernel, states[i], int(actions[i]), out, work)
        np.testing.assert_allclose(out, next_states[i], atol=2e-6)
        np.testing.assert_allclose([reward, done], [rewards[i], dones[i]], atol=2e-6)


def test_equal_ses_are_equal(cartpole: Task) -> None:
    one, same, other = make_se(cartpole), make_se(cartpole), make_se(cartpole)
    other.psi[0] += 1
    assert one.se == same.se
    assert hash(one.se) == hash(same.se)
    assert one == same
    assert one.se != other.se
    assert one != other
    assert one.se != one.psi.tolist()


class TestFile:
    def test_round_trip(self, se_file: Path, cartpole: Task) -> None:
        before, after = make_se(cartpole), load_se(se_file)
        assert after.architecture == before.architecture
        np.testing.assert_array_equal(after.psi, before.psi)
        assert (after.task_id, after.step_limit, after.solved_reward) == ("CartPole-v0", 200, 195.0)
        assert after.info == {"score_mean": 12.5}

    @pytest.mark.parametrize("position", [-1, -200, -1000])
    def test_a_wrong_weight_is_told(self, position: int, se_file: Path) -> None:
        content = bytearray(se_file.read_bytes())
        content[position] ^= 1
        se_file.write_bytes(content)
        with pytest.raises(InvalidInput, match="its checksum is wrong"):
            load_se(se_file)

    def test_a_file_of_another_tool_without_checksum_is_read(self, se_file: Path) -> None:
        with safetensors.safe_open(se_file, framework="numpy") as file:
            header = file.metadata()["se"]
        safetensors.numpy.save_file(safetensors.numpy.load_file(se_file), se_file, {"se": header})
        assert load_se(se_file).task_id == "CartPole-v0"

    @pytest.mark.parametrize(
        ("name", "value"), [("slope", 0.1), ("done", 0.9), ("inputs", "state, then one-hot action")]
    )
    def test_a_file_that_is_to_be_read_in_another_way_is_refused(
        self, name: str, value: Any, se_file: Path
    ) -> None:
        with safetensors.safe_open(se_file, framework="numpy") as file:
            header = json.loads(file.metadata()["se"])
        del header["sha256"]
        header["reading"][name] = value
        tensors = safetensors.numpy.load_file(se_file)
        safetensors.numpy.save_file(tensors, se_file, {"se": json.dumps(header)})
        with pytest.raises(InvalidInput, match=rf"reading.{name} must be .*; got {value!r}"):
            load_se(se_file)

    def test_a_file_with_values_that_are_not_finite_is_refused(
        self, cartpole: Task, tmp_path: Path
    ) -> None:
        path = tmp_path / "nan.safetensors"
        save_se(make_se(cartpole), path)
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata()
        tensors = safetensors.numpy.load_file(path)
        tensors["reward.0.bias"][0] = np.nan
        safetensors.numpy.save_file(tensors, path, metadata)
        with pytest.raises(InvalidInput, match=r"tensor reward.0.bias has values that are not fin"):
            load_se(path)

    def test_what_could_not_be_read_again_is_not_written(
        self, cartpole: Task, tmp_path: Path
    ) -> None:
        good, path = make_se(cartpole), tmp_path / "se.safetensors"
        save_se(good, path)
        content = path.read_bytes()
        psi = np.where(np.arange(good.psi.size) == 3, np.nan, good.psi)
        circle: dict[str, Any] = {}
        wide = replace(good.architecture, hidden_layers=99)
        circle["itself"] = circle
        for changes, told in (
            ({"se": SE(good.architecture, psi)}, "psi of the SE has values that are not finite"),
            ({"solved_reward": np.inf}, "solved_reward: must be a finite number; got inf"),
            ({"step_limit": 0}, "SE: step_limit: .*; got 0"),
            ({"se": SE(wide, np.zeros(wide.parameter_count, np.float32))}, "hidden_layers"),
            ({"info": {1: 2, "1": 3}}, "equal keys"),
            ({"info": {"a": "\udc80"}}, "SE"),
            ({"info": circle}, "info of an SE must be plain values: Circular"),
        ):
            with pytest.raises(InvalidInput, match=told):
                save_se(replace(good, **changes), path)
            assert path.read_bytes() == content
        given: Any = good.se
        with pytest.raises(InvalidInput, match="an SE must be a StoredSE, as `learn` and `load`"):
            save_se(given, path)
        numbers: Any = {"step_limit": np.int64(200), "solved_reward": np.float32(195)}
        save_se(replace(good, **numbers), path)
        assert load_se(path).solved_reward == 195

    def test_an_se_does_not_change_with_the_array_that_it_was_made_of(self, cartpole: Task) -> None:
        psi = np.array(make_se(cartpole).psi)
        se = SE(make_se(cartpole).architecture, psi)
        digest = se.digest
        psi[0] += 1
        assert se.digest == digest

    def test_tensors_carry_names_and_shapes(self, se_file: Path) -> None:
        tensors = safetensors.numpy.load_file(se_file)
        assert tensors["next_state.0.weight"].shape == (12, 6)
        assert tensors["done.1.bias"].shape == (1,)

    def test_info_that_json_cannot_hold_is_told(self, cartpole: Task, tmp_path: Path) -> None:
        se = replace(make_se(cartpole), info={"score": np.float32(1.0)})
        with pytest.raises(InvalidInput, match=r"info of an SE must be plain values: .*float32"):
            save_se(se, tmp_path / "se.safetensors")
        assert not list(tmp_path.iterdir())

    def test_missing(self, tmp_path: Path) -> None:
        with pytest.raises(InvalidInput, match="no SE file"):
            load_se(tmp_path / "none.safetensors")

    def test_malicious_pickle_is_not_executed(self, tmp_path: Path) -> None:
        class Bomb:
            def __reduce__(self):  # type: ignore[no-untyped-def]
                return Path.touch, (tmp_path / "executed",)

        path = tmp_path / "bomb.safetensors"
        path.write_bytes(pickle.dumps(Bomb()))
        with pytest.raises(InvalidInput, match="damaged or not an SE file"):
            load_se(path)
        assert not (tmp_path / "executed").exists()

    @pytest.mark.parametrize(
        "change",
        [
            {"format": "other"},
            {"version": 99},
            {"architecture": {"hidden_layers": 7}},
            {"architecture": {"hidden_size": 10**9}},
            {"architecture": {"state_size": -1}},
            {"architecture": {"activation": "__import__"}},
            {"architecture": {"hidden_size": 13}},
            {"architecture": {"step_limit": 0}},
            {"architecture": {"step_limit": 1.5}},
            {"architecture": {"reward_scale": 1.0}},
            {"step_limit": "many"},
            {"step_limit": 0},
            {"solved_reward": float("nan")},
        ],
    )
    def test_wrong_header(self, se_file: Path, change: dict[str, object]) -> None:
        with safetensors.safe_open(se_file, framework="numpy") as file:
            header = json.loads(file.metadata()["se"])
        del header["sha256"]  # which would be wrong in any case
        tensors = safetensors.numpy.load_file(se_file)
        for key, value in change.items():
            header[key] = {**header[key], **value} if isinstance(value, dict) else value
        safetensors.numpy.save_file(tensors, se_file, {"se": json.dumps(header)})
        with pytest.raises(InvalidInput, match="damaged or not an SE file"):
            load_se(se_file)

    def test_foreign_safetensors(self, tmp_path: Path) -> None:
        path = tmp_path / "foreign.safetensors"
        safetensors.numpy.save_file({"weight": np.zeros(3)}, path)
        with pytest.raises(InvalidInput, match="tensors of something else than an SE"):
            load_se(path)

    @settings(max_examples=200)
    @given(data=st.data())
    def test_damage_anywhere_is_told_or_harmless(
        self, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
    ) -> None:
        path = tmp_path_factory.mktemp("se") / "se.safetensors"
        save_se(make_se(get_task("CartPole-v0")), path)
        content = bytearray(path.read_bytes())
        if data.draw(st.booleans()):
            content = content[: data.draw(st.integers(0, len(content) - 1))]
        else:
            for position in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1)):
                content[position] = data.draw(st.integers(0, 255))
        path.write_bytes(content)
        with contextlib.suppress(InvalidInput):  # any other exception fails the test
            se = load_se(path)
            assert se.psi.shape == (se.architecture.parameter_count,)


def test_the_same_se_is_the_same_file(se_file: Path) -> None:
    """safetensors writes several entries of metadata in random order."""
    assert {se_bytes(load_se(se_file)) for _ in range(20)} == {se_file.read_bytes()}


def test_an_se_of_other_sizes_than_its_task_is_refused(tmp_path: Path) -> None:
    """Compiled code does not check the sizes."""
    se = replace(make_se(get_task("CartPole-v0")), task_id="Acrobot-v1")
    with pytest.raises(InvalidInput, match="4 state dimensions and 2 actions: Acrobot-v1 has 6"):
        se.task()


def test_the_task_of_an_imported_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "poles.py").write_text(
        "import gymnasium\n"
        "entry = gymnasium.spec('CartPole-v1').entry_point\n"
        "gymnasium.register('Pole-v0', entry_point=entry, max_episode_steps=50)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    se = replace(make_se(get_task("CartPole-v0")), task_id="poles:Pole-v0")
    with pytest.raises(InvalidInput, match=r"'poles'.*not imported.*give --task poles:Pole-v0"):
        se.task()
    importlib.import_module("poles")
    try:
        assert se.task().id == "poles:Pole-v0"
    finally:
        del sys.modules["poles"], gymnasium.registry["Pole-v0"]


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("layers", [1, 2])
def test_the_documented_reader(
    activation: Any, layers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reader of SE files in docs/se-files.md gives what the package gives."""
    task, rng = get_task("Acrobot-v1"), np.random.default_rng(0)
    small = make_se(task, layers, activation)
    se = replace(small, se=replace(small.se, psi=2 * small.psi))  # so that some episodes end
    save_se(se, tmp_path / "best_se.safetensors")
    monkeypatch.chdir(tmp_path)
    code: dict[str, Any] = {}
    exec(documented_code("se-files.md"), code)
    states = rng.standard_normal((40, task.state_size)).astype(np.float32)
    actions = rng.integers(task.n_actions, size=40)
    expected = SEModule(se)(torch.from_numpy(states), torch.from_numpy(actions))
    found = [code["step"](s, a) for s, a in zip(states, actions, strict=True)]
    for i, output in enumerate(expected[:2]):
        np.testing.assert_allclose(np.array([f[i] for f in found]), output, rtol=1e-3, atol=1e-4)
    clear = np.abs(expected[2].numpy() - 0.5) > 1e-3
    ends = np.array([f[2] for f in found])
    np.testing.assert_array_equal(ends[clear], expected[2].numpy()[clear] > 0.5)


@pytest.mark.filterwarnings("ignore:.*out of date")  # the paper's CartPole-v0
@pytest.mark.parametrize("name", ENTRIES)
def test_the_documented_reader_reads_the_zoo(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rewards are the package's to 0.001, as the page says."""
    (tmp_path / "best_se.safetensors").write_bytes(zoo_file(name).read_bytes())
    monkeypatch.chdir(tmp_path)
    code: dict[str, Any] = {}
    exec(documented_code("se-files.md"), code)
    env, rng = gymnasium.make(env_id(name)), np.random.default_rng(0)
    state, _ = env.reset(seed=0)
    for action in rng.integers(code["n_actions"], size=200):
        following, reward, terminated, truncated, _ = env.step(action)
        read = code["step"](state, action)
        np.testing.assert_allclose(read[0], following, atol=1e-4)
        assert abs(read[1] - float(reward)) < 1e-3
        state = env.reset()[0] if terminated or truncated else following


def test_psi_is_float32_without_gaps_and_of_the_right_length(
    se_file: Path, tmp_path: Path, rng: np.random.Generator
) -> None:
    se = load_se(se_file)
    noisy: Any = se.psi + rng.normal(size=se.psi.size)  # float64
    column = np.stack([noisy, noisy], axis=1)[:, 0]  # strided
    for psi in (noisy, column):
        save_se(replace(se, se=replace(se.se, psi=psi)), tmp_path / "noisy")
        np.testing.assert_array_equal(load_se(tmp_path / "noisy").psi, noisy.astype(np.float32))
    for psi in (noisy[:-1], np.append(noisy, 0.0), noisy[None]):
        with pytest.raises(InvalidInput, match=r"psi has shape .* networks have \d+ parameters"):
            replace(se.se, psi=psi)

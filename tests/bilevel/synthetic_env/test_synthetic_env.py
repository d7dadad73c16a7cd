import contextlib
import json
import pickle
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from bilevel import InvalidInput
from bilevel.hyperparameters import ACTIVATIONS
from bilevel.kernels.synthetic_env import step
from bilevel.synthetic_env import SE, load_se, save_se, se_bytes
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import Task, get_task
from tests.documents import documented_code
from tests.ses import make_se


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("layers", [1, 2])
@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1", "Pendulum-v1"])
def test_the_torch_module_equals_the_kernel(task_id: str, layers: int, activation: str) -> None:
    task = get_task(task_id)
    se = make_se(task, layers, activation)
    rng = np.random.default_rng(2)
    states = rng.normal(0, 1, (20, task.state_size)).astype(np.float32)
    actions: Any = rng.integers(0, task.action_size, 20)
    if task.continuous:
        actions = rng.uniform(-1, 1, (20, task.action_size)).astype(np.float32)
    next_states, rewards, dones = SEModule(se)(torch.from_numpy(states), torch.from_numpy(actions))
    work = np.zeros((2, 3 * 12), np.float32)
    out = np.zeros(task.state_size, np.float32)
    for i in range(20):
        reward, done = step(se.se.kernel, states[i], actions[i], out, work)
        np.testing.assert_allclose(out, next_states[i], atol=2e-6)
        np.testing.assert_allclose([reward, done], [rewards[i], dones[i]], atol=2e-6)


def test_psi_is_copied_as_float32(cartpole: Task, rng: np.random.Generator) -> None:
    se = make_se(cartpole).se
    noisy: Any = se.psi + rng.normal(size=se.psi.size)  # float64
    found = replace(se, psi=noisy)
    expected = noisy.astype(np.float32)
    noisy[0] += 1
    np.testing.assert_array_equal(found.psi, expected)
    for psi in (noisy[:-1], noisy[None]):
        with pytest.raises(InvalidInput, match=r"psi has shape .* networks have \d+ parameters"):
            replace(se, psi=psi)


def rewrite(path: Path, change: Callable[[dict[str, Any], dict[str, Any]], None]) -> None:
    """Change header and tensors of an SE file, and remove its checksum."""
    with safetensors.safe_open(path, framework="numpy") as file:
        header = json.loads(file.metadata()["se"])
    tensors = safetensors.numpy.load_file(path)
    header.pop("sha256", None)
    change(header, tensors)
    safetensors.numpy.save_file(tensors, path, {"se": json.dumps(header)})


class TestFile:
    def test_round_trip(self, se_file: Path, cartpole: Task) -> None:
        stored = load_se(se_file)
        assert stored == make_se(cartpole)
        assert stored.psi.dtype == np.float32
        assert {se_bytes(stored) for _ in range(20)} == {se_file.read_bytes()}

    def test_files_of_other_tools_need_no_checksum(self, se_file: Path, cartpole: Task) -> None:
        rewrite(se_file, lambda header, tensors: None)
        assert load_se(se_file) == make_se(cartpole)

    @pytest.mark.parametrize("position", [-1, -200, -1000])
    def test_a_changed_weight_is_detected(self, position: int, se_file: Path) -> None:
        content = bytearray(se_file.read_bytes())
        content[position] ^= 1
        se_file.write_bytes(content)
        with pytest.raises(InvalidInput, match="its checksum is wrong"):
            load_se(se_file)

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"format": "other"}, "format"),
            ({"version": 99}, "version: must be 1; got 99"),
            ({"architecture": {"hidden_layers": 7}}, "number of its parameters"),
            ({"architecture": {"hidden_size": 10**9}}, "hidden_size"),
            ({"architecture": {"activation": "__import__"}}, "activation"),
            ({"architecture": {"step_limit": 0}}, "architecture.step_limit"),
            ({"architecture": {"reward_scale": 1.0}}, "unknown 'architecture.reward_scale'"),
            ({"step_limit": "many"}, "step_limit"),
            ({"solved_reward": float("nan")}, "solved_reward"),
            ({"reading": {"slope": 0.1}}, "reading must be .*; got .*'slope': 0.1"),
        ],
    )
    def test_invalid_headers(self, se_file: Path, change: dict[str, Any], message: str) -> None:
        def update(header: dict[str, Any], tensors: dict[str, Any]) -> None:
            for key, value in change.items():
                header[key] = {**header[key], **value} if isinstance(value, dict) else value

        rewrite(se_file, update)
        with pytest.raises(InvalidInput, match=f"is damaged or not an SE file: .*{message}"):
            load_se(se_file)

    def test_invalid_tensors(self, se_file: Path) -> None:
        rewrite(se_file, lambda header, tensors: tensors["reward.0.bias"].fill(np.nan))
        with pytest.raises(InvalidInput, match="psi has values that are not finite"):
            load_se(se_file)
        rewrite(se_file, lambda header, tensors: tensors.update(x=tensors.pop("done.0.bias")))
        with pytest.raises(InvalidInput, match=r"tensor done.0.bias must be float32\[12\]"):
            load_se(se_file)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"solved_reward": np.inf}, "solved_reward: must be a finite number; got inf"),
            ({"step_limit": 0}, "step_limit: .*; got 0"),
            ({"info": {"a": "\udc80"}}, "header"),
            ({"info": {"score": np.float32(1.0)}}, "header: .*float32 is not JSON serializable"),
            ({"psi": np.nan}, "psi has values that are not finite"),
        ],
    )
    def test_an_invalid_se_is_not_written(
        self, changes: Any, message: str, cartpole: Task, se_file: Path
    ) -> None:
        stored, content = make_se(cartpole), se_file.read_bytes()
        if "psi" in changes:
            changes = {"se": SE(stored.architecture, stored.psi * changes["psi"])}
        with pytest.raises(InvalidInput, match=message):
            save_se(replace(stored, **changes), se_file)
        assert se_file.read_bytes() == content

    def test_other_files(self, tmp_path: Path) -> None:
        class Bomb:
            def __reduce__(self) -> Any:
                return Path.touch, (tmp_path / "executed",)

        path = tmp_path / "se.safetensors"
        with pytest.raises(InvalidInput, match="no SE file"):
            load_se(path)
        with pytest.raises(InvalidInput, match="is damaged or not an SE file"):
            load_se(tmp_path)
        safetensors.numpy.save_file({"weight": np.zeros(3)}, path)
        with pytest.raises(InvalidInput, match="not an SE file: header: Invalid JSON"):
            load_se(path)
        path.write_bytes(pickle.dumps(Bomb()))
        with pytest.raises(InvalidInput, match="damaged or not an SE file"):
            load_se(path)
        assert not (tmp_path / "executed").exists()

    @settings(max_examples=200)
    @given(data=st.data())
    def test_random_damage_raises_only_invalid_input(
        self, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
    ) -> None:
        path = tmp_path_factory.mktemp("se") / "se.safetensors"
        content = bytearray(se_bytes(make_se(get_task("CartPole-v0"))))
        if data.draw(st.booleans()):
            content = content[: data.draw(st.integers(0, len(content) - 1))]
        else:
            for position in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1)):
                content[position] = data.draw(st.integers(0, 255))
        path.write_bytes(content)
        with contextlib.suppress(InvalidInput):
            se = load_se(path)
            assert se.psi.shape == (se.architecture.parameter_count,)


def test_an_se_must_fit_its_task() -> None:
    """Compiled code does not check sizes."""
    se = replace(make_se(get_task("CartPole-v0")), task_id="Acrobot-v1")
    with pytest.raises(InvalidInput, match=r"has 4 state dimensions and 2 discr.*has 6"):
        se.task()


def test_a_file_does_not_cause_imports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "poles.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    se = replace(make_se(get_task("CartPole-v0")), task_id="poles:Pole-v0")
    with pytest.raises(InvalidInput, match=r"'poles'.*not imported.*give --task poles:Pole-v0"):
        se.task()
    assert "poles" not in sys.modules


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("layers", [1, 2])
def test_the_documented_reader_equals_the_torch_module(
    activation: Any, layers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reader in docs/se-files.md."""
    task, rng = get_task("Acrobot-v1"), np.random.default_rng(0)
    small = make_se(task, layers, activation)
    se = replace(small, se=replace(small.se, psi=2 * small.psi))  # so that some episodes end
    save_se(se, tmp_path / "best_se.safetensors")
    monkeypatch.chdir(tmp_path)
    code: dict[str, Any] = {}
    exec(documented_code("se-files.md"), code)
    states = rng.standard_normal((40, task.state_size)).astype(np.float32)
    actions = rng.integers(task.action_size, size=40)
    expected = SEModule(se)(torch.from_numpy(states), torch.from_numpy(actions))
    found = [code["step"](s, a) for s, a in zip(states, actions, strict=True)]
    for i, output in enumerate(expected[:2]):
        np.testing.assert_allclose(np.array([f[i] for f in found]), output, rtol=1e-3, atol=1e-4)
    clear = np.abs(expected[2].numpy() - 0.5) > 1e-3
    ends = np.array([f[2] for f in found])
    np.testing.assert_array_equal(ends[clear], expected[2].numpy()[clear] > 0.5)

import contextlib
import json
import pickle
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
from bilevel.durable import checksum
from bilevel.errors import OtherVersion, StorageFailure
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES, NESState
from bilevel.nes.checkpoint import load_state
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import save_se
from bilevel.tasks import Task, get_task
from tests.results import made_up_result


def after(nes: NES, state: NESState, score: float | None = None) -> NESState:
    """Return the state after one round, in which request i scores i if no score is given."""
    return nes.tell(
        state,
        [
            made_up_result(r.index, float(r.index) if score is None else score)
            for r in nes.ask(state)
        ],
    )


@pytest.fixture
def nes(cartpole: Task, small_hp: Hyperparameters) -> NES:
    return NES(cartpole, small_hp, seed=4)


@pytest.fixture(scope="module")
def default() -> NES:
    """A small run of the default recipe, whose state has a scale of observations."""
    hp = load_recipe("default", "CartPole-v0")
    return NES(
        get_task("CartPole-v0"),
        replace(
            hp,
            nes=replace(hp.nes, population_size=2, start_candidates=3, centre_agents=2),
            se=replace(hp.se, hidden_size=8),
        ),
    )


@pytest.fixture(scope="module")
def saved(default: NES, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A checkpoint after one generation."""
    state = default.init()
    while not state.records:
        state = after(default, state)
    path = tmp_path_factory.mktemp("saved") / "state"
    default.save(state, path)
    return path.read_bytes()


@pytest.mark.parametrize("steps", [0, 1, 2, 3, 4])
def test_a_resumed_run_equals_an_uninterrupted_one(
    steps: int, default: NES, tmp_path: Path
) -> None:
    """Also while the start is being chosen."""
    state = default.init()
    for _ in range(steps):
        state = after(default, state)
    default.save(state, tmp_path / "state")
    loaded = default.load(tmp_path / "state")
    assert default.ask(loaded) == default.ask(state)
    assert (loaded.phase, loaded.records) == (state.phase, state.records)
    assert [f.rank for f in loaded.finalists] == [f.rank for f in state.finalists]
    assert default.best(loaded) == default.best(state)
    np.testing.assert_array_equal(
        after(default, loaded).search.average, after(default, state).search.average
    )


def test_a_confirmation_resumes_and_a_finished_run_can_be_extended(
    cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    few = replace(small_hp.nes, solved_for=1, confirming_agents=8, generations=1)
    nes = NES(cartpole, replace(small_hp, nes=few), seed=4)
    state = after(nes, after(nes, nes.init(), 200.0), 200.0)
    nes.save(state, tmp_path / "state")
    loaded = nes.load(tmp_path / "state")
    assert (loaded.phase, nes.ask(loaded)) == (state.phase, nes.ask(state))
    rejected = after(nes, loaded, 1.0)
    assert (rejected.refuted, rejected.finished) == (1, True)
    nes.save(rejected, tmp_path / "state")
    more = NES(cartpole, replace(small_hp, nes=replace(few, generations=2)), seed=4)
    assert nes.load(tmp_path / "state").finished
    assert not more.load(tmp_path / "state").finished


def test_another_format(default: NES, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bilevel.nes.checkpoint.RUN_FORMAT", 99)
    default.save(default.init(), tmp_path / "state")
    monkeypatch.undo()
    with pytest.raises(OtherVersion, match="has format 99, this version reads format"):
        default.load(tmp_path / "state")


def test_checkpoints_of_other_runs(nes: NES, acrobot: Task, tmp_path: Path) -> None:
    """Only the number of generations and the recipe's name may differ."""
    path, hp = tmp_path / "state", nes.hp
    nes.save(nes.init(), path)
    others = {
        "seed": replace(nes, seed=nes.seed + 1),
        "nes.std_dev": replace(nes, hp=replace(hp, nes=replace(hp.nes, std_dev=0.77))),
        "se.hidden_size": replace(nes, hp=replace(hp, se=replace(hp.se, hidden_size=24))),
        "task.id": replace(nes, task=acrobot),
        "task.step_limit": replace(nes, task=replace(nes.task, step_limit=77)),
    }
    for name, other in others.items():
        with pytest.raises(InvalidInput, match=rf"belongs to a run with {name} = .*, not "):
            other.load(path)
    longer = replace(hp, recipe="mine", nes=replace(hp.nes, generations=999))
    assert replace(nes, hp=longer).load(path).generation == 0
    assert load_state(path).generation == 0
    save_se(nes.current(nes.init()), path)
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        nes.load(path)


def test_unreadable_checkpoints(nes: NES, tmp_path: Path) -> None:
    """A disk error is not damage: the file may be readable later."""
    (tmp_path / "state").mkdir()
    with pytest.raises(StorageFailure, match=r"cannot read checkpoint .*: Is a directory"):
        nes.load(tmp_path / "state")
    with pytest.raises(InvalidInput, match="no checkpoint at"):
        nes.load(tmp_path / "none")


@given(data=st.data())
@settings(max_examples=200)
def test_a_flipped_byte_is_detected_or_harmless(
    data: st.DataObject, saved: bytes, default: NES, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("damaged") / "state"
    path.write_bytes(saved)
    whole = default.load(path)
    content = bytearray(saved)
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with contextlib.suppress(InvalidInput):
        read = default.load(path)
        np.testing.assert_array_equal(read.search.mean, whole.search.mean)
        assert read.records == whole.records


@pytest.mark.parametrize(
    "changes",
    [
        {"generation": float("inf")},
        {"generation": 2},
        {"records": [{"x": 1}]},
        {"finalists": [{"generation": 0}]},
        {"phase": {"phase": "sleeping"}},
        {"search": {"tensor": "missing"}},
        {"colour": "red"},
    ],
)
def test_a_wrong_state_with_a_right_checksum(
    changes: dict[str, object], saved: bytes, default: NES, tmp_path: Path
) -> None:
    (tmp_path / "whole").write_bytes(saved)
    with safetensors.safe_open(tmp_path / "whole", framework="numpy") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        header = json.loads(file.metadata()["nes"])
    assert header.pop("sha256") == digest(header, tensors)
    header["state"] |= changes
    header["sha256"] = digest(header, tensors)
    safetensors.numpy.save_file(tensors, tmp_path / "state", {"nes": json.dumps(header)})
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        default.load(tmp_path / "state")


def digest(header: dict[str, Any], tensors: dict[str, Any]) -> str:
    """Return the checksum that the file format prescribes."""
    parts = [json.dumps(header).encode()]
    for name, tensor in sorted(tensors.items()):
        parts += [f"{name} {tensor.dtype} {tensor.shape}".encode(), tensor.tobytes()]
    return checksum(*parts)


def test_pickles_are_not_executed(tmp_path: Path, default: NES) -> None:
    class Bomb:
        def __reduce__(self):  # type: ignore[no-untyped-def]
            return Path.touch, (tmp_path / "executed",)

    torch.save(Bomb(), tmp_path / "torch")
    for content in (pickle.dumps(Bomb()), b"\x80\x04", (tmp_path / "torch").read_bytes()):
        (tmp_path / "state").write_bytes(content)
        with pytest.raises(InvalidInput, match="damaged checkpoint"):
            default.load(tmp_path / "state")
    assert not (tmp_path / "executed").exists()

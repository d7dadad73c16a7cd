import contextlib
import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from bilevel import InvalidInput
from bilevel.errors import OtherVersion, StorageFailure
from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import Hyperparameters, SEHyperparameters, load_recipe
from bilevel.nes import NES, NESState
from bilevel.nes.checkpoint import _checksum, load_state, save_state
from bilevel.synthetic_env import save_se
from bilevel.tasks import Task, get_task
from tests.results import made_up_result

CARTPOLE = get_task("CartPole-v0")


def answer(request: EvaluationRequest, score: float) -> EvaluationResult:
    return made_up_result(request.index, score)


def after(nes: NES, state: NESState) -> NESState:
    return nes.tell(state, [answer(r, float(r.index)) for r in nes.ask(state)])


@pytest.fixture
def nes(cartpole: Task, small_hp: Hyperparameters) -> NES:
    return NES(cartpole, small_hp, seed=4)


@pytest.fixture(scope="module")
def default() -> NES:
    """A small run of the default recipe, whose state has a scale of observations."""
    hp = load_recipe("default", CARTPOLE.id)
    return NES(
        CARTPOLE,
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
    save_state(state, path)
    return path.read_bytes()


def load(path: Path, nes: NES) -> NESState:
    return nes.load(path)


@pytest.mark.parametrize("steps", [0, 1, 2, 3, 4])
def test_a_loaded_run_goes_on_as_the_other_would(steps: int, default: NES, tmp_path: Path) -> None:
    """Also while the start is being chosen, not only between generations."""
    state = default.init()
    for _ in range(steps):
        state = after(default, state)
    save_state(state, tmp_path / "state")
    loaded = load(tmp_path / "state", default)
    assert default.ask(loaded) == default.ask(state)
    assert (loaded.race, loaded.records) == (state.race, state.records)
    assert loaded.real_env_steps == state.real_env_steps
    assert [f.rank for f in loaded.finalists] == [f.rank for f in state.finalists]
    np.testing.assert_array_equal(loaded.best.psi, state.best.psi)
    assert loaded.best.info == state.best.info
    np.testing.assert_array_equal(
        after(default, loaded).se.centre.psi, after(default, state).se.centre.psi
    )


def test_a_confirmation_under_way_is_kept_and_more_generations_go_on(
    cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    few = replace(small_hp.nes, solved_for=1, confirming_agents=8, generations=1)
    nes = NES(cartpole, replace(small_hp, nes=few), seed=4)
    state = nes.tell(nes.init(), [answer(r, 200.0) for r in nes.ask(nes.init())])
    state = nes.tell(state, [answer(r, 200.0) for r in nes.ask(state)])
    save_state(state, tmp_path / "state")
    loaded = nes.load(tmp_path / "state")
    assert nes.ask(loaded) == nes.ask(state)
    assert loaded.confirmation == state.confirmation
    over = nes.tell(loaded, [answer(r, 1.0) for r in nes.ask(loaded)])
    assert over.refuted == 1
    save_state(over, tmp_path / "state")
    more = NES(cartpole, replace(small_hp, nes=replace(few, generations=2)), seed=4)
    assert nes.load(tmp_path / "state").finished
    assert not more.load(tmp_path / "state").finished


@pytest.mark.parametrize("content", [b"", b"nonsense", b"\x08\0\0\0\0\0\0\0{}      "])
def test_damage_is_told(content: bytes, tmp_path: Path, nes: NES) -> None:
    (tmp_path / "state").write_bytes(content)
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        load(tmp_path / "state", nes)


def test_a_checkpoint_of_another_format_is_refused(
    default: NES, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not damaged, and to begin anew would hide that the run is another one now."""
    monkeypatch.setattr("bilevel.nes.checkpoint.RUN_FORMAT", 1)
    save_state(default.init(), tmp_path / "state")
    monkeypatch.undo()
    with pytest.raises(OtherVersion, match="has format 1, this version reads format"):
        load(tmp_path / "state", default)


def test_a_checkpoint_of_another_seed_is_refused(nes: NES, tmp_path: Path) -> None:
    """Its SE files would tell the wrong seed."""
    save_state(nes.init(), tmp_path / "state")
    other = replace(nes, seed=nes.seed + 1)
    with pytest.raises(InvalidInput, match=f"is of a run with seed {nes.seed}, not {other.seed}"):
        other.load(tmp_path / "state")
    assert nes.load(tmp_path / "state").generation == 0


def test_a_checkpoint_of_another_run_is_refused(nes: NES, acrobot: Task, tmp_path: Path) -> None:
    """It is not damaged, and its SE files would tell the wrong hyperparameters. A run may become
    longer, and have another name."""
    path = tmp_path / "state"
    save_state(nes.init(), path)
    hp = nes.hp
    others = {
        "nes.std_dev": replace(nes, hp=replace(hp, nes=replace(hp.nes, std_dev=0.77))),
        "se.hidden_size": replace(nes, hp=replace(hp, se=replace(hp.se, hidden_size=24))),
        "task.id": replace(nes, task=acrobot),
        "task.step_limit": replace(nes, task=replace(nes.task, step_limit=77)),
    }
    for name, other in others.items():
        with pytest.raises(InvalidInput, match=rf"^the checkpoint .* of a run with {name} = "):
            other.load(path)
    longer = replace(hp, recipe="mine", nes=replace(hp.nes, generations=999))
    assert replace(nes, hp=longer).load(path).generation == 0
    save_se(nes.init().current, path)
    with pytest.raises(InvalidInput, match="is an SE file, not a checkpoint"):
        nes.load(path)


def test_a_checkpoint_that_cannot_be_read_is_not_damaged(nes: NES, tmp_path: Path) -> None:
    """The disk may be back in a moment; what lies on it is whole."""
    (tmp_path / "state").mkdir()
    with pytest.raises(StorageFailure, match=r"cannot read checkpoint .*: Is a directory"):
        nes.load(tmp_path / "state")


def test_no_checkpoint(nes: NES, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no checkpoint at"):
        nes.load(tmp_path / "none")


def test_a_checkpoint_of_other_ses_is_refused(saved: bytes, default: NES, tmp_path: Path) -> None:
    (tmp_path / "state").write_bytes(saved)
    other: SEHyperparameters = replace(default.hp.se, hidden_size=9)
    with pytest.raises(InvalidInput, match="parts do not fit together"):
        load_state(tmp_path / "state", default.task, other)


@given(data=st.data())
@settings(max_examples=200)
def test_one_wrong_byte_is_told_or_harmless(
    data: st.DataObject, saved: bytes, default: NES, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("damaged") / "state"
    path.write_bytes(saved)
    whole = load(path, default)
    content = bytearray(saved)
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with contextlib.suppress(InvalidInput):
        read = load(path, default)
        np.testing.assert_array_equal(read.se.mean, whole.se.mean)
        assert read.records == whole.records


@given(content=st.binary(max_size=200))
def test_any_bytes_are_refused(
    content: bytes, default: NES, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("foreign") / "state"
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        load(path, default)


@pytest.mark.parametrize(
    "changes",
    [
        {"generation": float("inf")},
        {"generation": 2},
        {"records": [{"x": 1}]},
        {"finalists": [{"generation": 0}]},
        {"race": {"seeds": 1}},
        {"colour": "red"},
    ],
)
def test_a_wrong_header_with_a_right_checksum_is_refused(
    changes: dict[str, object], saved: bytes, default: NES, tmp_path: Path
) -> None:
    (tmp_path / "whole").write_bytes(saved)
    with safetensors.safe_open(tmp_path / "whole", framework="numpy") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        header = json.loads(file.metadata()["nes"])
    del header["sha256"]
    header |= changes
    header["sha256"] = _checksum(json.dumps(header), tensors)
    safetensors.numpy.save_file(tensors, tmp_path / "state", {"nes": json.dumps(header)})
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        load(tmp_path / "state", default)


@pytest.mark.parametrize("header", ["[]", "7", "{}", "[" * 100_000])
def test_no_header_is_refused(header: str, default: NES, tmp_path: Path) -> None:
    tensors = {"theta": np.zeros(3, np.float32)}
    safetensors.numpy.save_file(tensors, tmp_path / "state", {"nes": header})
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        load(tmp_path / "state", default)


def test_a_pickle_is_not_executed(tmp_path: Path, default: NES) -> None:
    class Bomb:
        def __reduce__(self):  # type: ignore[no-untyped-def]
            return Path.touch, (tmp_path / "executed",)

    for content in (pickle.dumps(Bomb()), b"\x80\x04" + pickle.dumps(Bomb())):
        (tmp_path / "state").write_bytes(content)
        with pytest.raises(InvalidInput, match="damaged checkpoint"):
            load(tmp_path / "state", default)
    torch.save(Bomb(), tmp_path / "state")
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        load(tmp_path / "state", default)
    assert not (tmp_path / "executed").exists()

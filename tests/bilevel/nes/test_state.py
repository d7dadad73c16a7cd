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
from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import Hyperparameters, load_preset
from bilevel.nes import NES, NESState
from bilevel.nes.state import _checksum
from bilevel.tasks import Task, get_task


def answer(request: EvaluationRequest, score: float) -> EvaluationResult:
    return EvaluationResult((score,), 100, 10, True, index=request.index, seconds=0.01)


@pytest.fixture
def nes(cartpole: Task, small_hp: Hyperparameters) -> NES:
    return NES(cartpole, small_hp, seed=4)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A checkpoint after one generation."""
    hp = load_preset("tuned", "CartPole-v0", "antithetic")
    hp = replace(
        hp,
        nes=replace(hp.nes, population_size=2, start_candidates=1),
        se=replace(hp.se, hidden_size=4),
    )
    nes = NES(get_task("CartPole-v0"), hp, 0)
    state = nes.start()
    path = tmp_path_factory.mktemp("saved") / "state"
    nes.tell(state, [answer(r, float(r.index)) for r in nes.ask(state)], 1.0, 5.0).save(path)
    return path.read_bytes()


def test_round_trip(nes: NES, tmp_path: Path) -> None:
    state = nes.start()
    results = [answer(r, float(r.index)) for r in nes.ask(state)]
    state = nes.tell(state, results, 1.0, 0.0)
    state.save(tmp_path / "state")
    loaded = NESState.load(tmp_path / "state")
    assert loaded.records == state.records
    assert [f.rank(1.0) for f in loaded.finalists] == [f.rank(1.0) for f in state.finalists]
    np.testing.assert_array_equal(loaded.finalists[0].psi, state.finalists[0].psi)
    assert (loaded.generation, loaded.best_score) == (1, 1.0)
    np.testing.assert_array_equal(loaded.psi, state.psi)
    assert nes.ask(loaded) == nes.ask(state)


def test_a_loaded_run_goes_on_as_the_other_would(nes: NES, tmp_path: Path) -> None:
    """Also where the next step depends on the last: momentum, and what was adapted."""
    own = replace(nes.hp.nes, momentum=0.8, retention=0.7)
    nes = replace(nes, hp=replace(nes.hp, nes=own))

    def after(state: NESState) -> NESState:
        results = [answer(r, float(r.index)) for r in nes.ask(state)]
        return nes.tell(state, results, 1.0, 0.0)

    state = after(nes.start())
    state.save(tmp_path / "state")
    loaded = NESState.load(tmp_path / "state")
    assert loaded.scale == state.scale != 1.0
    np.testing.assert_array_equal(after(loaded).psi, after(state).psi)
    assert after(loaded).records == after(state).records


@pytest.mark.parametrize("content", [b"", b"nonsense", b"\x08\0\0\0\0\0\0\0{}      "])
def test_damage_is_told(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "state").write_bytes(content)
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        NESState.load(tmp_path / "state")


@given(data=st.data())
@settings(max_examples=200)
def test_one_wrong_byte_is_told_or_harmless(
    data: st.DataObject, saved: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("damaged") / "state"
    path.write_bytes(saved)
    whole = NESState.load(path)
    content = bytearray(saved)
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with contextlib.suppress(InvalidInput):
        read = NESState.load(path)
        np.testing.assert_array_equal(read.psi, whole.psi)
        assert read.records == whole.records


@given(content=st.binary(max_size=200))
def test_any_bytes_are_refused(content: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("foreign") / "state"
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        NESState.load(path)


@pytest.mark.parametrize(
    "header",
    [
        "[]",
        "7",
        "{}",
        "[" * 100_000,
        '{"generation": Infinity, "scale": 1, "solved_streak": 0, "finalists": [], "records": []}',
        '{"generation": 1, "scale": 1, "solved_streak": 0, "finalists": [], "records": []}',
        '{"generation": 1, "scale": 1, "solved_streak": 0, "finalists": [], "records": [{"x": 1}]}',
        '{"generation": 0, "scale": 1, "solved_streak": 0, "finalists": [{"generation": 0}],'
        ' "records": []}',
        '{"generation": 0, "scale": 0, "solved_streak": 0, "finalists": [], "records": []}',
        '{"generation": 0, "scale": Infinity, "solved_streak": 0, "finalists": [], "records": []}',
    ],
)
def test_a_wrong_header_with_a_right_checksum_is_refused(header: str, tmp_path: Path) -> None:
    tensors = {"psi": np.zeros(3, np.float32)}
    if header.startswith("{"):
        parsed = json.loads(header)
        parsed["sha256"] = _checksum(json.dumps(parsed), tensors)
        header = json.dumps(parsed)
    safetensors.numpy.save_file(tensors, tmp_path / "state", {"nes": header})
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        NESState.load(tmp_path / "state")


def test_a_pickle_is_not_executed(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self):  # type: ignore[no-untyped-def]
            return Path.touch, (tmp_path / "executed",)

    for content in (pickle.dumps(Bomb()), b"\x80\x04" + pickle.dumps(Bomb())):
        (tmp_path / "state").write_bytes(content)
        with pytest.raises(InvalidInput, match="damaged checkpoint"):
            NESState.load(tmp_path / "state")
    torch.save(Bomb(), tmp_path / "state")
    with pytest.raises(InvalidInput, match="damaged checkpoint"):
        NESState.load(tmp_path / "state")
    assert not (tmp_path / "executed").exists()

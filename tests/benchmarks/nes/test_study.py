from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.machine import read_result
from benchmarks.nes.picture import picture, results_digests, update_rules_picture
from benchmarks.nes.step_limits import measured
from benchmarks.nes.study import VARIANTS, Study, commands, seconds
from benchmarks.nes.tables import TASKS, variant_row
from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import Hyperparameters, load_preset
from bilevel.nes import NES
from bilevel.synthetic_env import Architecture, StoredSE, save_se
from bilevel.tasks import Task


def run(**changes: Any) -> dict[str, Any]:
    row = {
        "seed": 0,
        "generations": 20,
        "first_solved_generation": 10,
        "solved_since": 0.5,
        "minutes": 2.0,
        "final_score_mean": 199.0,
        "varied": {},
    }
    return row | changes


def test_failures_are_counted() -> None:
    failed = run(seed=1, first_solved_generation=None, solved_since=None, final_score_mean=60.0)
    measured = run(seed=2, varied={"ddqn": {"score_mean": 196.0, "train_steps_mean": 5000}})
    cells = variant_row("x", [run(), failed, measured], 195.0)
    assert cells[1] == "2 of 3"
    assert cells[2] == "10 (10 to 10)"
    assert cells[3] == "50%"
    assert cells[6:8] == ["196.0 (196.0 to 196.0)", "1 of 1"]


def test_a_variant_that_never_solved_has_a_row() -> None:
    failed = run(first_solved_generation=None, solved_since=None, final_score_mean=9.0)
    assert variant_row("x", [failed], 195.0)[:4] == ["x", "0 of 1", "-", "0%"]


def test_a_run_that_stood_still_took_what_it_ran(cartpole: Task, small_hp: Hyperparameters) -> None:
    """40 s for the start, 10 s a generation, a day between the second and the third."""
    nes = NES(cartpole, small_hp, 0)
    state = nes.start()
    for finished in (150.0, 160.0, 86_570.0):
        results = [
            EvaluationResult((1.0,), 100, 10, True, request.index, 0.01)
            for request in nes.ask(state)
        ]
        state = nes.tell(state, results, 10.0, finished)
    assert seconds(state.records, begun=100.0) == 40.0 + 3 * 10.0


@pytest.mark.parametrize("task", TASKS)
class TestResults:
    def test_defaults_are_those_of_the_package(self, task: str) -> None:
        """Results of other defaults would be shown under a wrong name."""
        measured = read_result(f"nes_{task}")["variants"]["defaults"]
        expected = load_preset("tuned", task).to_dict()
        del expected["nes"]["generations"]
        assert measured["hyperparameters"] == expected

    def test_all_variants_are_known_and_have_all_seeds_asked_for(self, task: str) -> None:
        for name, variant in read_result(f"nes_{task}")["variants"].items():
            assert variant["options"] == VARIANTS[name]
            seeds = " ".join(str(row["seed"]) for row in variant["runs"])
            assert any(f"--seeds {seeds} " in command for command in variant["commands"])


def test_commands_are_those_of_the_rows(tmp_path: Path) -> None:
    study = Study("CartPole-v0", 15, tmp_path)
    (alone,) = commands(study, "defaults", [run(), run(seed=1)])
    assert "--seeds 0 1 --generations 15 --transfers 0 " in alone
    all_three = {"ddqn": {"agents": 20}, "dueling-ddqn": {"agents": 10}, "td3": {"agents": 10}}
    rows = [run(varied=all_three), run(seed=1, varied={"ddqn": {"agents": 20}})]
    first, second = commands(study, "defaults", rows)
    assert "--seeds 0 1 --generations 15 --transfers 20 --agents ddqn --home" in first
    assert "--seeds 0 --generations 15 --transfers 10 --agents dueling-ddqn td3 --home" in second


def test_longer_episodes_take_more_steps(cartpole: Task, tmp_path: Path) -> None:
    """On one SE, by the same agents; ten episodes are random, and convergence takes twenty."""
    architecture = Architecture(4, 2, 1, 8, "relu", step_limit_share=0.5)
    psi = architecture.initialize(np.random.default_rng(0))
    *_, done = architecture.split(psi)
    done *= 0  # no episode ends before its limit
    file = tmp_path / "se.safetensors"
    save_se(StoredSE(architecture, psi, cartpole.id, 200, 195.0), file)
    short, long = (measured(cartpole.id, file, "ddqn", share, 2) for share in (0.05, 0.1))
    assert short["train_steps_mean"] >= 30 * 10
    assert long["train_steps_mean"] >= 30 * 20
    assert short["train_steps_mean"] < long["train_steps_mean"]


def test_the_pictures_show_the_committed_results() -> None:
    for path, digest in results_digests().items():
        assert digest in path.read_text(), "run `python -m benchmarks.nes.picture`"
    assert len(picture().axes) == 3 * len(TASKS)
    assert len(update_rules_picture().axes) == 2 * len(TASKS)

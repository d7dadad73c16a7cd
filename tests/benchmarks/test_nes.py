from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks import machine
from benchmarks.machine import NotMeasured, write_result
from benchmarks.nes import run
from benchmarks.nes.rewards import LIMIT, score_of_rewards, steps_of_direct_search
from benchmarks.nes.run import core_seconds_per_se
from benchmarks.nes.tables import seeds, taught
from bilevel.hyperparameters import Hyperparameters
from bilevel.synthetic_env import load_se
from bilevel.tasks import Task, get_task
from bilevel.zoo import zoo_file


@pytest.mark.parametrize(("solved_reward", "solved"), [(1.0, True), (201.0, False)])
def test_a_run_is_solved_by_the_score_of_fresh_agents(
    solved_reward: float,
    solved: bool,
    small_hp: Hyperparameters,
    cartpole: Task,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run, "FINAL_AGENTS", 2)
    hp = replace(small_hp, nes=replace(small_hp.nes, generations=1))
    assert run.run_nes(replace(cartpole, solved_reward=solved_reward), hp, 3)["solved"] == solved


def test_failed_runs_count_towards_the_cost_of_an_se() -> None:
    runs = [{"core_seconds": 10.0, "confirmed": confirmed} for confirmed in (True, True, False)]
    assert core_seconds_per_se(runs) == 15
    assert core_seconds_per_se(runs[2:]) == float("inf")


def run_of(seed: int, **changes: Any) -> dict[str, Any]:
    values = {
        "seed": seed,
        "seconds_to_se": 20.0 + seed,
        "seconds": 30.0 + seed,
        "core_seconds": 40.0 + seed,
        "generations": 10 + seed,
        "final_train_steps": 500,
        "solved": True,
        "confirmed": True,
        "real_env_steps": 1_000_000,
        "core_utilisation": 0.9,
    }
    return {**values, **changes}


@pytest.fixture(autouse=True)
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path)


def write(runs: list[dict[str, Any]]) -> None:
    write_result("nes_seeds_CartPole-v0", "it CartPole-v0 --seeds 0-2 --taught 1", {"runs": runs})


def test_the_table_counts_failures() -> None:
    """The end of a run without an SE is not a time to an SE."""
    write([run_of(0), run_of(1, solved=False), run_of(2, confirmed=False)])
    row = seeds().splitlines()[2]
    assert row.startswith("| CartPole-v0 | 2 of 3 (9% to 99%) | 2 of 3 | 20 (20 to 21) |")
    assert "| 31 (30 to 32) | 41 (40 to 42) |" in row
    assert row.endswith("| 11 (10 to 12) | 500 (500 to 500) | 1000 (1000 to 1000) | 90% |")


def test_incomplete_results_are_left_out() -> None:
    write([run_of(0), run_of(1)])
    with pytest.raises(NotMeasured, match="some seeds"):
        seeds()


def test_scores_of_agents_are_means_over_ses() -> None:
    by_se = [
        {
            "ddqn": {"scores": scores, "train_steps": [100, 300]},
            "sb3 DQN, 2,500 steps": {"scores": scores},
        }
        for scores in ([200.0, 196.0], [190.0, 192.0])
    ]
    write([run_of(0, taught=by_se[0]), run_of(1, taught=by_se[1]), run_of(2)])
    ours, theirs = taught().splitlines()[2:4]
    cells = "| 2 | 2 | 194.5 (191.0 to 198.0) |"
    assert ours == f"| CartPole-v0 | ddqn {cells} 1 (target 195) | 200 |"
    assert theirs == f"| CartPole-v0 | sb3 DQN, 2,500 steps {cells} 2 (target 190) | - |"


def test_the_action_with_the_highest_reward_is_scored_on_the_real_task(cartpole: Task) -> None:
    assert score_of_rewards(cartpole, load_se(zoo_file("CartPole-v0")).se, 0) >= 195
    assert 1950 <= steps_of_direct_search(cartpole, cartpole.unit_scale, 0) < LIMIT
    car = get_task("MountainCarContinuous-v0")
    assert steps_of_direct_search(car, car.observation_scale(0), 0) < LIMIT

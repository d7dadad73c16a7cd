from dataclasses import replace

import numpy as np
import pytest

from benchmarks.machine import read_result
from benchmarks.nes import update_rules
from benchmarks.nes.tables import RULE_TASKS, TASKS
from benchmarks.nes.update_rules import hyperparameters, random_start, rules, run
from bilevel.hyperparameters.definitions import SCORE_TRANSFORMS, UPDATES


@pytest.mark.parametrize("task", TASKS)
def test_rules_differ_in_the_update_alone(task: str) -> None:
    found = {name: hyperparameters(task, name) for name in rules(task)}
    assert {hp.nes.update for hp in found.values()} == set(UPDATES)
    for update in ("paper", "authors"):
        tried = [hp.nes.score_transform for hp in found.values() if hp.nes.update == update]
        assert sorted(tried) == sorted(SCORE_TRANSFORMS)
    free = ("update", "score_transform", "step_size", "std_dev")
    adapted = ("retention", "momentum", "fallback")
    plain = found["paired"]
    for name, hp in found.items():
        same = {field: getattr(plain.nes, field) for field in free}
        if name == "paired, adapted":
            same |= {field: getattr(plain.nes, field) for field in adapted}
        assert replace(hp, nes=replace(hp.nes, **same)) == plain


def test_a_run_is_summed_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(update_rules.PLAIN, "population_size", 2)
    psi = random_start("CartPole-v0", 1, candidates=2)
    np.testing.assert_array_equal(psi, random_start("CartPole-v0", 1, candidates=2))
    row = run("CartPole-v0", "authors, rank", 1, psi, generations=2, agents=2)
    assert len(row["score_curve"]) == 2
    assert all(8 <= score <= 200 for score in row["score_curve"])
    assert row["solved_at_the_end"] == (row["score_curve"][-1] >= 195)
    assert (row["first_solved_generation"] is None) == (max(row["score_curve"]) < 195)
    assert row["best"]["train_steps_mean"] > 0
    # the start is evaluated before any rule makes its step
    other = run("CartPole-v0", "authors, linear", 1, psi, generations=1, agents=2)
    assert other["score_curve"] == row["score_curve"][:1]


@pytest.mark.parametrize("task", RULE_TASKS)
def test_results_are_of_these_rules(task: str) -> None:
    for name, found in read_result(f"update_rules_{task}")["rules"].items():
        assert found["options"] == rules(task)[name]
        seeds = " ".join(str(row["seed"]) for row in found["runs"])
        assert f"--seeds {seeds} --generations {found['generations']}" in found["command"]
        assert {len(row["score_curve"]) for row in found["runs"]} == {found["generations"]}

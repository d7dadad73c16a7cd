from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.machine import read_result
from benchmarks.nes import tables, update_rules
from benchmarks.nes.tables import TASKS
from benchmarks.nes.update_rules import (
    Found,
    command,
    hyperparameters,
    main,
    random_start,
    rules,
    run,
)
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
    monkeypatch.setattr(update_rules, "AGENTS", 2)
    monkeypatch.setitem(update_rules.PLAIN, "population_size", 2)
    psi = random_start("CartPole-v0", 1, candidates=2)
    row = run("CartPole-v0", "authors, rank", 1, psi, generations=2)
    assert len(row["score_curve"]) == 2
    assert all(8 <= score <= 200 for score in row["score_curve"])
    assert row["solved_at_the_end"] == (row["score_curve"][-1] >= 195)
    assert (row["first_solved_generation"] is None) == (max(row["score_curve"]) < 195)
    assert row["best"]["train_steps_mean"] > 0
    # the start is evaluated before any rule makes its step
    other = run("CartPole-v0", "authors, linear", 1, psi, generations=1)
    assert other["score_curve"] == row["score_curve"][:1]


def test_runs_are_kept_as_long_as_their_options_are(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("benchmarks.machine.RESULTS", tmp_path)
    found = Found("CartPole-v0", generations=3)
    for rule, seed in (("antithetic", 1), ("paired", 4), ("paired", 1)):
        found.add(rule, {"seed": seed})
    again = Found("CartPole-v0", generations=3)
    assert again.runs("paired") == {1: {"seed": 1}, 4: {"seed": 4}}
    assert not again.runs("authors, rank")
    assert not Found("CartPole-v0", generations=4).runs("paired")
    assert not Found("Acrobot-v1", generations=3).runs("paired")
    written = read_result("update_rules_CartPole-v0")["rules"]
    assert list(written) == ["paired", "antithetic"]  # in the order of `rules`
    assert "--rules 'paired' --seeds 1 4 --generations 3" in written["paired"]["command"]
    assert written["paired"]["runs"] == [{"seed": 1}, {"seed": 4}]
    # other step sizes are another rule: its runs do not mix with the former ones
    monkeypatch.setattr(update_rules, "_MOMENTUM", 0.5)
    monkeypatch.setattr(update_rules, "_STEPS_OF_ONE", 2.0)
    again.add("paired", {"seed": 2})
    assert again.runs("paired") == {2: {"seed": 2}}
    assert again.runs("antithetic") == {1: {"seed": 1}}


def test_minutes_of_another_machine_are_marked(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("benchmarks.machine.RESULTS", tmp_path)
    row = {
        "seed": 1,
        "first_solved_generation": None,
        "solved_at_the_end": False,
        "minutes": 1.5,
        "best": {"score_mean": 100.0, "train_steps_mean": 2000},
        "score_curve": [50.0],
    }
    found = Found("CartPole-v0", generations=1)
    found.add("paired", row)
    found.add("antithetic", row)
    assert "*" not in tables.update_rules("CartPole-v0")
    monkeypatch.setattr(update_rules, "machine", lambda: {"cores": 64, "processor": "another"})
    found.add("authors, rank", row)
    *_, first, second, third, _, source, _, other, _ = tables.update_rules(
        "CartPole-v0"
    ).splitlines()
    assert ["*" in line for line in (first, second, third)] == [False, False, True]
    assert "another" not in source
    assert other == "\\* 64 cores of another:"


def test_a_call_runs_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("benchmarks.machine.RESULTS", tmp_path)
    monkeypatch.setattr(update_rules, "CANDIDATES", 2)
    monkeypatch.setattr(update_rules, "AGENTS", 2)
    monkeypatch.setitem(update_rules.PLAIN, "population_size", 2)
    call = ["update_rules", "CartPole-v0", "--seeds", "1", "--generations", "1", "--jobs", "1"]
    for names, ran in ((["paired"], "paired"), (["paired", "antithetic"], "antithetic")):
        monkeypatch.setattr("sys.argv", [*call, "--rules", *names])
        main()
        assert capsys.readouterr().out.startswith(f"1 of 1: {ran}, ")
    written = read_result("update_rules_CartPole-v0")["rules"]
    assert {name: [run["seed"] for run in rule["runs"]] for name, rule in written.items()} == {
        "paired": [1],
        "antithetic": [1],
    }


@pytest.mark.parametrize("task", TASKS)
def test_results_are_of_these_rules(task: str) -> None:
    for name, found in read_result(f"update_rules_{task}")["rules"].items():
        assert found["options"] == rules(task)[name]
        seeds = [row["seed"] for row in found["runs"]]
        assert found["command"] == command(task, name, seeds, found["generations"])
        assert {len(row["score_curve"]) for row in found["runs"]} == {found["generations"]}

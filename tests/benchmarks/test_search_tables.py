from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import machine
from benchmarks.machine import NotMeasured, read_result, write_result
from benchmarks.search.comparison import method_rows, methods, p_value
from benchmarks.search.recipes import RECIPES, TASKS, p_values, quality
from benchmarks.search.studies import committed, cost, overrun
from bilevel.recipes import load_recipe
from cluster.bohb.study.journal import ResultLine
from cluster.bohb.study.profiles import METHODS
from search_spaces.translation import of_hyperparameters


def fresh(cost: float, solved: int = 2, of: int = 2) -> list[dict[str, Any]]:
    return [{"core_seconds": cost, "solved": i < solved} for i in range(of)]


def test_p_is_exact_for_few_pairs() -> None:
    """Of 64 permutations within six pairs, two are as extreme as six wins."""
    costs = np.array([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])
    assert p_value(costs, 2 * costs) == pytest.approx(2 / 64)
    assert p_value(costs, costs) == 1


def test_methods_are_compared_over_common_seeds() -> None:
    measured: dict[str, Any] = {"default": {"fresh": fresh(30)}}
    for seed in range(3):
        for method, core_seconds in zip(METHODS, (10, 20, 40), strict=True):
            row = {"method": method, "seed": seed, "fresh": fresh(core_seconds * (seed + 1))}
            measured[f"{method} {seed}"] = row
    measured["random 0"]["fresh"] = fresh(10)  # a tie with BOHB
    measured["random 2"]["fresh"].pop()  # incomplete
    measured["random 3"] = {"method": "random", "seed": 3, "search": {}}
    default, bohb, hyperband, random = method_rows("CartPole-v0", measured)
    assert default[2:] == ["-", "2 of 2", "30", "-", "-"]
    assert bohb[2:] == ["3", "6 of 6", "20 (10 to 30)", "-", "-"]
    assert hyperband[2:] == ["3", "6 of 6", "40 (20 to 60)", "3, 0, 0", "0.25"]
    assert random[2:] == ["2", "4 of 4", "45 (10 to 80)", "1, 1, 0", "1.00"]


def test_each_comparison_has_its_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path)
    with pytest.raises(NotMeasured, match="search_"):
        methods()
    for name, core_seconds in (("CartPole-v0", 30), ("CartPole-v0_scale-1000", 40)):
        rows = {"default": {"fresh": fresh(core_seconds)}}
        write_result(f"search_{name}", "compare", {"rows": rows})
    lines = [line.split(" | ") for line in methods().splitlines() if "exogenous" in line]
    assert [(cells[0], cells[4]) for cells in lines] == [
        ("| CartPole-v0, scale of 1000 steps", "40"),
        ("| CartPole-v0", "30"),
    ]


@pytest.mark.parametrize("task", RECIPES)
def test_no_seed_was_used_for_two_recipes(task: str) -> None:
    """So no recipe was chosen on the seeds that another one is compared on."""
    seeds = [
        {run["seed"] for run in read_result(f"nes_seeds_{task}{suffix}")["runs"]}
        for suffix in RECIPES[task].values()
    ]
    assert sum(map(len, seeds)) == len(set.union(*seeds))


def test_quality_and_p_values_of_recipes() -> None:
    def run(cost: float, confirmed: bool, solved: bool) -> dict[str, Any]:
        outcome = {"confirmed": confirmed, "solved": solved}
        return {"core_seconds": cost, "final_train_steps": 500, **outcome}

    runs = [run(10, True, True), run(20, True, False), run(60, False, True)]
    assert quality(runs) == ("2 of 3", "2 of 3", "1 of 2", "20 (10 to 60)", "45", "500")
    assert p_values(runs, runs) == ("1", "1")
    # A run that failed early does not count as cheap.
    sound, failed = [run(20 + i, True, True) for i in range(9)], [run(10, False, False)] * 9
    assert p_values(sound, failed) == p_values(failed, sound) == ("0.00016", "4.1e-05")


@pytest.mark.parametrize("task", TASKS)
def test_the_default_is_the_incumbent_of_a_committed_study(task: str) -> None:
    """The recipe `exogenous` was the default then. Values are equal up to rounding."""
    folders = {study.journal.folder: study for study in committed()}
    (study,) = (
        study
        for folder, study in folders.items()
        if (folder.parent.name, folder.name) == (task, "default-episodes")
    )
    assert study.incumbent is not None
    assert study.incumbent.loss == min(line.objective for line in study.finalists)
    found = study.journal.proposals[study.incumbent.id].configuration
    default = load_recipe("exogenous", task)
    assert of_hyperparameters(default, found) == pytest.approx(found, rel=0.02)


def test_cost_and_overrun_of_a_study() -> None:
    """Pauses do not count, and parallel trials count once."""

    def line(started: float, finished: float, budget: int = 1, spent: float = 1.0) -> ResultLine:
        stamps = {"submitted": 0.0, "started": started, "finished": finished}
        return ResultLine((0, 0, 0), budget, 1.0, {"core_seconds": spent}, stamps)

    lines = [line(7200, 10800), line(0, 3600), line(1800, 5400), line(2000, 3000)]
    assert cost(4500, lines) == "1.2 core hours in 150 min"
    lines = [line(0, 1, budget, spent) for budget, spent in [(10, 11), (10, 13), (30, 60)]]
    assert overrun(lines) == "20%, 30%"

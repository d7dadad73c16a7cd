from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from benchmarks import machine
from benchmarks.machine import NotMeasured
from benchmarks.search.comparison import (
    _incumbents,
    _largest_budget,
    _noise,
    _rows,
    core_seconds_per_solved,
    methods,
    p_value,
)
from cluster.bohb.study.journal import Origin
from cluster.bohb.study.profiles import METHODS


def fresh(cost: float, solved: int = 2, of: int = 2) -> list[dict[str, Any]]:
    return [{"core_seconds": cost, "solved": i < solved} for i in range(of)]


def test_failed_runs_are_paid_for() -> None:
    assert core_seconds_per_solved(fresh(10)) == 10
    assert core_seconds_per_solved(fresh(10, solved=1)) == 20
    assert core_seconds_per_solved(fresh(10, solved=0)) == float("inf")


def test_p_is_exact_for_few_pairs() -> None:
    """Of the 64 ways to exchange six pairs, two are as far from even as six wins."""
    costs = np.array([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])
    assert p_value(costs, 2 * costs) == pytest.approx(2 / 64)
    assert p_value(costs, costs) == 1


def test_a_method_is_compared_over_the_seeds_that_both_have() -> None:
    measured: dict[str, Any] = {"default": {"fresh": fresh(30)}}
    for seed in range(3):
        for method, cost in zip(METHODS, (10, 20, 40), strict=True):
            row = {"method": method, "seed": seed, "fresh": fresh(cost * (seed + 1))}
            measured[f"{method} {seed}"] = row
    measured["random 0"]["fresh"] = fresh(10)  # the recipe that BOHB found too
    measured["random 2"]["fresh"].pop()  # its search is over, its fresh runs are not
    measured["random 3"] = {"method": "random", "seed": 3, "search": {}}
    default, bohb, hyperband, random = _rows("CartPole-v0", measured)
    assert default[2:] == ["-", "2 of 2", "30", "-", "-"]
    assert bohb[2:] == ["3", "6 of 6", "20 (10 to 30)", "-", "-"]
    assert hyperband[2:] == ["3", "6 of 6", "40 (20 to 60)", "3, 0, 0", "0.25"]
    assert random[2:] == ["2", "4 of 4", "45 (10 to 80)", "1, 1, 0", "1.00"]


def test_a_task_is_compared_with_each_scale_of_observations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path)
    with pytest.raises(NotMeasured, match="search_"):
        methods()
    rows = {"default": {"fresh": fresh(30)}}
    machine.write_result("search_Acrobot-v1", "compare Acrobot", {"rows": rows})
    command = "compare CartPole"
    machine.write_result("search_CartPole-v0", command, {"rows": rows})
    rows = {"default": {"fresh": fresh(40)}}
    machine.write_result("search_CartPole-v0_scale-1000", command, {"rows": rows})
    told = methods()
    assert [line.split(" | ")[:5:2] for line in told.splitlines() if "default" in line] == [
        ["| CartPole-v0, scale of 1000 steps", "-", "40"],
        ["| CartPole-v0", "-", "30"],
        ["| Acrobot-v1", "-", "30"],
    ]
    assert told.endswith("; `compare CartPole`, `compare Acrobot`)")  # the same command once


def test_what_reaches_the_largest_budget_is_told_by_method() -> None:
    def searched(
        method: str, at_random: list[int], of_model: list[int], seed: int = 0
    ) -> dict[str, Any]:
        outcomes = {
            budget: {
                Origin.RANDOM: [(9.0, confirmed) for confirmed in at_random],
                Origin.AROUND_RECIPE: [],
                Origin.MODEL: [(9.0, confirmed) for confirmed in of_model],
            }
            for budget in ("9", "27")
        }
        outcomes["9"][Origin.RANDOM].append((9.0, 1))  # not one that goes on
        return {"method": method, "seed": seed, "search": {"outcomes": outcomes}}

    measured: dict[str, Any] = {
        "default": {"fresh": []},
        "bohb 0": searched("bohb", [0], [1, 2, 1]),
        "bohb 1": searched("bohb", [2], [], seed=1),
        "hyperband 0": searched("hyperband", [0, 1], []),
        "hyperband 1": searched("hyperband", [0, 1], [], seed=1),
        "random 0": searched("random", [0, 0, 0, 0, 1], []),
        "random 1": searched("random", [0], [], seed=1),
        "bohb 2": searched("bohb", [9, 9, 9], [], seed=2),  # not all methods have this seed
        "hyperband 2": searched("hyperband", [9, 9], [], seed=2),
        "random 2": {"method": "random", "seed": 2},
    }
    random, hyperband, bohb = _largest_budget("CartPole-v0", measured)
    assert random[1:] == ("random search", "2", "6", "1", "", "0.5", "", "")
    assert hyperband[1:] == ("Hyperband", "2", "4", "2", "", "1.0", "0.5", "")
    assert bohb[1:] == ("BOHB", "2", "5", "4", "3 of 3", "2.0", "0.08", "0.52")


def test_incumbents_are_compared_with_their_validation() -> None:
    """Each once, whichever methods found it, and in the objective's own terms."""
    measured: dict[str, Any] = {"default": {"fresh": fresh(30)}}
    for seed, (validated, cost) in enumerate([(10, 30), (20, 20), (30, 40), (40, 80)]):
        runs = [
            {"core_seconds": cost / 2, "confirmed": True, "solved": False},
            {"core_seconds": cost * 1.5, "confirmed": True, "solved": True},
        ]
        search = {"incumbent": validated, "configuration": {"nes.std_dev": float(seed)}}
        for method in ("bohb", "random"):
            row = {"method": method, "seed": seed, "search": search, "fresh": runs}
            measured[f"{method} {seed}"] = row
    assert _incumbents("CartPole-v0", measured) == [
        ("CartPole-v0", "4", "1.67 (1.00 to 3.00)", "0.80", "0.2", "0.50 (0.50 to 0.50)")
    ]
    measured["random 3"]["fresh"] = measured["bohb 3"]["fresh"] = runs[:1]  # not complete
    assert _incumbents("CartPole-v0", measured) == []


def test_noise_is_split_into_what_seeds_and_recipes_have_in_common() -> None:
    rng = np.random.default_rng(0)

    def effects(n: int, variance: float) -> NDArray[np.float64]:
        drawn = rng.normal(size=n)
        scaled: NDArray[np.float64] = (drawn - drawn.mean()) * np.sqrt(variance / drawn.var(ddof=1))
        return scaled

    rest = rng.normal(size=(8, 6))
    rest += rest.mean() - rest.mean(0) - rest.mean(1, keepdims=True)
    rest *= np.sqrt(0.5 * (7 * 5) / (rest**2).sum())
    costs = np.exp(3 + effects(8, 2.0)[:, None] + effects(6, 1.0) + rest)
    measured = {
        str(place): {
            "search": {"configuration": {"nes.step_size": place, "nes.std_dev": 1.0}},
            "fresh": [{"core_seconds": cost} for cost in row],
        }
        for place, row in enumerate(costs)
    }
    same = {"configuration": {"nes.std_dev": 1.0, "nes.step_size": 7}}
    measured["again"] = {**measured["7"], "search": same}  # found by another search
    measured["begun"] = {"search": {"configuration": {}}, "fresh": [{"core_seconds": 1.0}]}
    measured["searched"] = {"search": {"configuration": {"nes.step_size": 9}}}
    ((_, recipes, seeds, *told, p),) = _noise("CartPole-v0", measured)
    assert (recipes, seeds) == ("8", "6")
    # Of the variance of a mean, a share is that of what it averages.
    assert told == [f"{2.0 - 0.5 / 6:.2f}", f"{1.0 - 0.5 / 8:.2f}", "0.50"]
    assert p == f"{f_distribution.sf(8 * 1.0 / 0.5, 5, 35):.2g}"
    assert _noise("CartPole-v0", {"default": {}}) == []

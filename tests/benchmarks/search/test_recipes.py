from typing import Any

import pytest

from benchmarks.machine import read_result
from benchmarks.search.recipes import RECIPES, _p_values, _quality


@pytest.mark.parametrize("task", RECIPES)
def test_no_seed_served_two_recipes(task: str) -> None:
    """So that no recipe was chosen on the seeds that another one is compared on."""
    seeds = [
        {run["seed"] for run in read_result(f"nes_seeds_{task}{ending}")["runs"]}
        for ending in RECIPES[task].values()
    ]
    assert sum(map(len, seeds)) == len(set.union(*seeds))


def test_recipes_are_told_by_all_of_their_runs() -> None:
    def run(cost: float, confirmed: bool, solved: bool) -> dict[str, Any]:
        return {
            "core_seconds": cost,
            "confirmed": confirmed,
            "solved": solved,
            "final_train_steps": 500,
        }

    runs = [run(10, True, True), run(20, True, False), run(60, False, True)]
    assert _quality(runs) == ("2 of 3", "2 of 3", "1 of 2", "20 (10 to 60)", "45", "500")
    assert _p_values(runs, runs) == ("1", "1")
    # A run that failed soon took no less than one that found an SE.
    sound, failed = [run(20 + i, True, True) for i in range(9)], [run(10, False, False)] * 9
    assert _p_values(sound, failed) == _p_values(failed, sound) == ("0.00016", "4.1e-05")
    assert _p_values(sound, [run(10, True, True)] * 9)[0] == "0.00016"

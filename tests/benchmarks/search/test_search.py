import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.machine import read_result
from benchmarks.search.picture import PICTURE, picture, results_digest
from benchmarks.search.study import Comparison, minutes_until
from benchmarks.search.tables import (
    TASKS,
    against_random,
    at_the_largest_budget,
    first_results,
    good_configurations,
    incumbents,
    is_good,
    method_row,
    proposals,
)
from cluster.bohb.journal import ConfigLine, Journal, ResultLine
from cluster.run_folder import Final, add_final
from tests.studies import make_study


def test_a_study_is_summed_up(tmp_path: Path) -> None:
    make_study(tmp_path / "CartPole-v0" / "bohb-3", fail=(0,))
    row = Comparison("CartPole-v0", ["5m"], tmp_path).row("bohb", 3, agents=2, varied=1)
    assert (row["method"], row["seed"], row["budgets"]) == ("bohb", 3, [1, 3])
    results = row["results"]
    assert len(results) == 6  # 3 and 1, then 2
    assert sum(line["objective"] is None for line in results) == 1
    assert [line["minutes"] for line in results] == sorted(line["minutes"] for line in results)
    configurations = {line["name"]: line for line in row["configurations"]}
    assert configurations.keys() == {line["configuration"] for line in results}
    for line in results:
        if line["objective"] is not None:
            course = configurations[line["configuration"]]["fitness"]
            assert line["objective"] == pytest.approx(np.mean(course[: line["budget"]]), abs=0.1)
    assert "nes.step_size" in configurations["000-0-000"]["values"]
    assert (row["own"]["agents"], row["varied"]["agents"]) == (2, 1)
    assert 0 < row["own"]["fitness_mean"] < row["own"]["score_mean"]  # steps are paid for


def test_a_study_that_is_there_is_not_run_again(tmp_path: Path) -> None:
    folder = tmp_path / "CartPole-v0" / "bohb-0"
    make_study(folder)
    before = (folder / "results.json").read_bytes()
    Comparison("CartPole-v0", ["5m"], tmp_path).run("bohb", 0)
    assert (folder / "results.json").read_bytes() == before


def test_what_lies_between_calls_is_not_counted(tmp_path: Path) -> None:
    """Begun at 100, results until 160, the end at 170; called again, its first job at 500."""
    folder = tmp_path / "study"
    folder.mkdir()
    settings = {"kind": "study", "identity": "0" * 32, "begun": 100.0}
    (folder / "settings.json").write_text(json.dumps(settings))
    add_final(folder, Final(1, 170.0, {}))
    add_final(folder, Final(2, 600.0, {}))
    for number, (submitted, finished) in enumerate([(110.0, 160.0), (500.0, 530.0)]):
        line = ResultLine(
            (0, 0, number), 1, 0.0, {}, dict.fromkeys(("submitted", "started"), submitted)
        )
        line.timestamps["finished"] = finished
        Journal(folder).add_config(ConfigLine(line.id, {}, {}))
        Journal(folder).add_result(line)
    journal = Journal(folder)
    assert minutes_until(160.0, folder, journal) == pytest.approx(1.0)
    assert minutes_until(530.0, folder, journal) == pytest.approx((430.0 - 330.0) / 60)


RESULTS = [
    {"configuration": name, "budget": budget, "objective": objective, "minutes": minutes}
    for name, budget, objective, minutes in (
        ("a", 3, 190.0, 1.0),
        ("b", 3, None, 1.1),
        ("c", 9, 180.0, 1.2),
        ("a", 9, 185.0, 1.3),
        ("d", 9, None, 1.4),
        ("e", 9, 170.0, 1.5),
    )
]


def study(fitness: float, **changes: Any) -> dict[str, Any]:
    learned = {"score_mean": 199.0, "train_steps_mean": 1000, "fitness_mean": fitness}
    row = {
        "own": learned,
        "varied": learned,
        "budgets": [3, 9],
        "configurations": [{"name": name, "model_based": name == "a"} for name in "abcde"],
        "results": RESULTS,
    }
    return row | changes


def test_what_costs_too_many_steps_is_not_good() -> None:
    studies = [study(196.0), study(194.9), study(197.0)]
    assert [is_good(one, 195.0) for one in studies] == [True, False, True]
    cells = method_row("random", studies, 195.0)
    assert cells[:4] == ["random search", "0 of 3", "2 of 3", "185.0 (185.0 to 185.0)"]
    assert cells[4] == "196.0 (194.9 to 197.0)"
    assert cells[-2:] == ["3 (3 to 3)", "0 (0 to 0)"]


def test_a_configuration_is_good_that_solves_the_task_at_the_largest_budget() -> None:
    one, other = study(190.0), study(190.0, results=RESULTS[:1])
    assert good_configurations(one, 180.0) == 2  # 180 and 185, not the 190 of three generations
    assert good_configurations(one, 185.5) == 0
    cells = method_row("bohb", [one, other], 180.0)
    assert cells[1] == "1 of 2"
    assert cells[-1] == "1 (0 to 2)"


def test_results_by_who_proposed_them_and_when_they_came() -> None:
    one = study(196.0)
    assert [(r["configuration"], r["budget"], r["model_based"]) for r in first_results(one)] == [
        ("a", 3, True),
        ("c", 9, False),
        ("e", 9, False),
    ]
    assert [line["configuration"] for line in at_the_largest_budget(one)] == ["c", "a", "e"]
    assert incumbents(one) == [(1.2, 180.0), (1.3, 185.0)]


def test_what_the_model_proposed_beside_what_was_drawn() -> None:
    told = proposals("bohb", [study(196.0), study(197.0)])
    assert "the 2 configurations that BOHB's model proposed have a median of 190.0" in told
    assert "of the 4 drawn at random 175.0" in told  # 180 and 170; failures have none
    without = study(196.0, configurations=[{"name": n, "model_based": False} for n in "abcde"])
    assert proposals("bohb", [without]) == "BOHB's model proposed nothing."


def test_what_is_the_same_is_no_defeat() -> None:
    ours = [study(197.0, seed=0), study(196.0, seed=1), study(195.0, seed=2)]
    theirs = [study(195.0, seed=2), study(196.5, seed=1), study(190.0, seed=0)]
    ours[0]["results"] = [*RESULTS, {**RESULTS[-1], "objective": 186.0}]
    theirs[0]["results"] = RESULTS[:2]  # none at the largest budget
    told = against_random("bohb", ours, theirs, 184.0)
    assert "configuration is higher from 2, lower from 0 and the same from 1 (sign test" in told
    assert "good configurations higher from 2, lower from 0 and the same from 1 (sign" in told
    assert "handed over higher from 1, lower from 1 and the same from 1 (sign test: p = 1" in told


@pytest.mark.parametrize("task", TASKS)
def test_every_method_has_the_seeds_asked_for(task: str) -> None:
    result = read_result(f"search_{task}")
    words = result["command"].split()
    seeds = words[words.index("--seeds") + 1 : words.index("--time-budgets")]
    methods = words[words.index("--methods") + 1 : words.index("--seeds")]
    found = [(study["method"], str(study["seed"])) for study in result["studies"]]
    assert sorted(found) == sorted((method, seed) for method in methods for seed in seeds)


def test_the_picture_shows_the_committed_results() -> None:
    assert results_digest() in PICTURE.read_text(), "run `python -m benchmarks.search.picture`"
    assert len(picture().axes) == 3 * len(TASKS)

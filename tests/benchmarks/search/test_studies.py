import math
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from scipy.stats import mannwhitneyu

import benchmarks
from benchmarks.machine import read_result
from benchmarks.search.cards import cards
from benchmarks.search.studies import (
    RECIPES,
    TimeSpent,
    _elapsed,
    _overrun,
    _p_values,
    _proposals,
    _quality,
    at_smallest,
    committed,
    outcomes,
    summary,
)
from bilevel.hyperparameters import load_recipe
from cluster.bohb.study.definition import RECIPE_FILE
from cluster.bohb.study.journal import ConfigLine, Journal, Origin, ResultLine
from search_spaces.translation import INVERSE, of_hyperparameters

STAMPS = {"submitted": 0.0, "started": 0.0, "finished": 0.0}


def test_the_committed_studies_hand_over_what_their_finalists_say() -> None:
    """The recipe in a study's folder is its incumbent's, over the validation's seeds."""
    studies = committed()
    assert studies
    for study in studies:
        told = summary(study)
        assert told.incumbent is not None
        losses = [line.loss for line in told.finalists if line.loss is not None]
        assert told.incumbent.loss == min(losses)
        recipe = load_recipe(str(study.folder / RECIPE_FILE), study.task.id)
        proposed = told.configuration(told.incumbent.id)
        assert of_hyperparameters(recipe, proposed) == pytest.approx(proposed)


@pytest.mark.parametrize("task", RECIPES)
def test_the_default_is_what_a_search_found(task: str) -> None:
    """Its values in the space that was searched, rounded; all others are as the search had them,
    but for the most generations of a run."""
    (study,) = (s for s in committed() if (s.task.id, s.name) == (task, "default-episodes"))
    told, default = summary(study), load_recipe("default", task)
    assert told.incumbent is not None
    found = told.configuration(told.incumbent.id)
    assert of_hyperparameters(default, found) == pytest.approx(found, rel=0.02)
    recipe = load_recipe(str(study.folder / RECIPE_FILE), task)
    free = {name.replace(INVERSE, "") for name in found} | {"nes.generations"}
    for section in ("nes", "se"):
        one, other = (asdict(hp.sections[section]) for hp in (recipe, default))
        assert {f"{section}.{name}" for name in one if one[name] != other[name]} <= free
    assert (recipe.agents, recipe.vary_agent) == (default.agents, default.vary_agent)


def test_pauses_do_not_count_and_trials_at_a_time_count_once() -> None:
    def ran(begun: float, finished: float) -> ResultLine:
        stamps = {"submitted": 0.0, "started": begun, "finished": finished}
        return ResultLine((0, 0, 0), 1, 1.0, {}, stamps)

    lines = [ran(7200, 10800), ran(0, 3600), ran(1800, 5400), ran(2000, 3000)]
    assert _elapsed(lines) == 2.5
    assert _elapsed([]) == 0.0


def test_what_a_study_took() -> None:
    assert str(TimeSpent(1.25, 0.5)) == "1.2 core hours in 30 min"
    stamps = {"submitted": 0.0, "started": 0.0, "finished": 1.0}
    lines = [
        ResultLine((0, 0, number), budget, 1.0, {"core_seconds": spent}, stamps)
        for number, (budget, spent) in enumerate([(10, 11.0), (10, 13.0), (30, 60.0)])
    ]
    assert _overrun(lines) == "20%, 30%"


def test_each_study_has_its_card() -> None:
    text = cards()
    for study in committed():
        assert f"## {study.task.id}/{study.name}\n" in text
    assert text.count("bilevel bohb") == len(committed())
    assert re.search(r"`nes.population_size` \| 6 → 3 \(3 to 48\)", text)


def test_nothing_committed_names_a_folder_of_the_machine() -> None:
    """Commands are told with folders within the project."""
    committed_by = Path(benchmarks.__file__).parent
    for path in committed_by.rglob("*.json*"):
        found = re.findall(r'[" =](/[A-Za-z0-9._-]+)+', path.read_text())
        assert not found, f"{path}: {found[:3]}"
    assert not [*committed_by.rglob(".lock")]


def test_proposals_are_compared_where_all_were_run(tmp_path: Path) -> None:
    """At the smallest budget; a failure counts as the worst."""
    journal = Journal(tmp_path)
    infos: list[dict[str, Any]] = [{"prior": "itself"}, {}, {"model_based_pick": True}, {}]
    for number, info in enumerate(infos):
        journal.add_config(ConfigLine((0, 0, number), {}, info))
    for number, budget, loss in ((0, 1, 9.0), (1, 1, None), (2, 1, 7.0), (3, 1, 8.0), (2, 3, 1.0)):
        info = {"confirmed": 2} if loss == 8.0 else {}
        journal.add_result(ResultLine((0, 0, number), budget, loss, info, STAMPS))
    found = outcomes(journal)
    assert found["3"][Origin.MODEL] == [(1.0, 0)]
    assert at_smallest(found) == {
        Origin.RANDOM: [(math.inf, 0), (8.0, 2)],
        Origin.AROUND_RECIPE: [],
        Origin.MODEL: [(7.0, 0)],
    }


def test_a_search_counts_once_where_several_are_compared() -> None:
    def searched(random: list[float], model: list[float]) -> dict[str, list[tuple[float, int]]]:
        return {
            Origin.RANDOM.value: [(one, 0) for one in random],
            Origin.MODEL.value: [(one, 1) for one in model],
        }

    searches = [searched([3.0, 4.0], [1.0, 2.0])] * 4 + [searched([1.0], [2.0, 3.0, 4.0])]
    random, model = _proposals("CartPole-v0", "five", searches)
    assert random[2:4] == (Origin.RANDOM.value, "0 of 9")
    assert model[3] == "11 of 11"
    # Four of five are as far apart as can be, and one the other way round: so are 12 of 32 signs.
    assert model[5:] == ("80%", "0.4")
    ((_, *_, better, p),) = _proposals("CartPole-v0", "one", searches[:1])[1:]
    assert better == "100%"
    assert float(p) == pytest.approx(mannwhitneyu([1, 2], [3, 4]).pvalue, rel=0.1)


def test_what_outran_the_budget_is_scaled_to_it(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.add_config(ConfigLine((0, 0, 0), {}, {}))
    journal.add_result(ResultLine((0, 0, 0), 30, 80.0, {"core_seconds": 40.0}, STAMPS))
    assert at_smallest(outcomes(journal))[Origin.RANDOM] == [(80.0, 0)]
    assert at_smallest(outcomes(journal, at_budget=True))[Origin.RANDOM] == [(60.0, 0)]


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
    assert _p_values(sound, failed) == _p_values(failed, sound) == ("0.0002", "4e-05")
    assert _p_values(sound, [run(10, True, True)] * 9)[0] == "0.0002"

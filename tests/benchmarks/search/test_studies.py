import re
from dataclasses import asdict
from pathlib import Path

import pytest
from scipy.stats import mannwhitneyu

import benchmarks
from benchmarks.search.cards import cards
from benchmarks.search.recipes import TASKS
from benchmarks.search.studies import (
    TimeSpent,
    _elapsed,
    _overrun,
    _proposals,
    committed,
    summary,
)
from bilevel.hyperparameters import load_recipe
from cluster.bohb.study.definition import RECIPE_FILE
from cluster.bohb.study.journal import Origin, ResultLine
from search_spaces.translation import INVERSE, of_hyperparameters


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


@pytest.mark.parametrize("task", TASKS)
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
    assert model[5:] == ("80%", "0.38")
    ((_, *_, better, p),) = _proposals("CartPole-v0", "one", searches[:1])[1:]
    assert better == "100%"
    assert float(p) == pytest.approx(mannwhitneyu([1, 2], [3, 4]).pvalue, rel=0.1)
    ((*_, better, p),) = _proposals("CartPole-v0", "none at random", [searched([], [1.0])])
    assert better == p == ""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bilevel.nes.state import Finished
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import Study
from tests.studies import MadeUpPool, new_study

ID, CONFIGURATION = (0, 0, 0), {"nes.population_size": 4}


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """A study whose runs end after three generations."""
    study = new_study(tmp_path)
    return replace(study, base=replace(study.base, nes=replace(study.base.nes, generations=3)))


def opened(study: Study, budget: float = 0.0) -> ConfigurationRuns:
    runs = ConfigurationRuns(study, ID, CONFIGURATION).read()
    runs.spend(budget, MadeUpPool())
    return runs


def test_seeds_depend_on_study_configuration_and_number(study: Study) -> None:
    runs = [ConfigurationRuns(study, (0, 0, number), {}) for number in range(3)]
    seeds = [each.run(number).seed for each in runs for number in range(2)]
    assert len(set(seeds)) == 6
    assert ConfigurationRuns(study, (0, 0, 1), CONFIGURATION).run(0).seed == seeds[2]
    assert ConfigurationRuns(replace(study, seed=4), (0, 0, 1), {}).run(0).seed not in seeds
    assert replace(runs[0], validation=True).run(0).seed not in seeds


def test_seeds_run_one_after_another_until_the_budget_is_spent(
    study: Study, tmp_path: Path
) -> None:
    opened(study, 1)
    runs = opened(study, 4)  # continues
    whole = opened(replace(study, folder=tmp_path / "other"), 4)
    assert runs.tally == whole.tally
    assert runs.tally.cost == pytest.approx(4.0, abs=0.5)
    assert ConfigurationRuns(study, ID, CONFIGURATION).read().tally == runs.tally
    assert len(runs.states) > 3
    assert all(state.finished for state in runs.states[:-1])
    starts = {state.search.mean.tobytes() for state in runs.states}
    assert len(starts) == len(runs.states)


@pytest.mark.parametrize("damage", [True, False])
def test_a_damaged_or_lost_run_is_repeated_and_the_others_stay(damage: bool, study: Study) -> None:
    before = opened(study, 3)
    assert len(before.states) > 2
    path = before.run(0).folder / "state.safetensors"
    path.write_bytes(b"damaged") if damage else path.unlink()
    assert not ConfigurationRuns(study, ID, CONFIGURATION).read().states
    again = opened(study, 3)
    assert again.tally == before.tally
    for state, expected in zip(again.states, before.states, strict=True):
        assert state.generation == expected.generation
        np.testing.assert_array_equal(state.search.mean, expected.search.mean)


def test_the_best_se_is_a_confirmed_one(study: Study) -> None:
    runs = opened(study)
    assert not runs.states
    runs.spend(3, MadeUpPool())
    scores = [state.finalists[0].rank[0] for state in runs.states[:3]]
    highest, other = int(np.argmax(scores)), int(np.argmin(scores))
    assert runs.best == runs.run(0).nes.best(runs.states[highest])
    runs.states[other] = replace(runs.states[other], phase=Finished(confirmed=True))
    assert runs.best == runs.run(0).nes.best(runs.states[other])

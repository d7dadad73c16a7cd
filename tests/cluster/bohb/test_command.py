"""How a study spreads over a cluster."""

import math
from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import pytest

from cluster.bohb.command import StudyCommand, brackets_to_reach, deadlines, more_than_asked
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import Journal
from cluster.bohb.study.profiles import ENDLESS
from cluster.ray.connection import Capacity
from cluster.session.context import RunContext
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, Status
from search_spaces.space import Space
from tests.studies import make_study, new_study


@pytest.fixture
def command(tmp_path: Path) -> StudyCommand:
    """Two brackets, which begin 3 and 2 configurations; no number of workers is given."""
    study = replace(new_study(tmp_path), schedule=Schedule((1, 3), 2))
    context = RunContext(Home(tmp_path), "sqlite:///none.db")
    return StudyCommand(study, context, 2, None, 4, workers_per_trial=0)


@pytest.mark.parametrize(
    ("cores", "runs", "workers", "trials"),
    [(2, 1, 1, 2), (5, 1, 1, 5), (20, 1, 4, 5), (20, 2, 2, 5), (10_000, 1, 98, 102)],
)
def test_more_workers_where_there_are_more_cores_than_configurations(
    command: StudyCommand, cores: int, runs: int, workers: int, trials: int
) -> None:
    """At most one for each evaluation of the largest generation that the space has."""
    capacity = Capacity(cores, runs)
    nes = replace(command.study.base.nes, population_size=2, centre_agents=2)
    study = replace(command.study, base=replace(command.study.base, nes=nes))
    placed = replace(command, study=study).placed(capacity)
    assert study.most_evaluations == replace(nes, population_size=48).evaluations == 98
    sizes = CS.ConfigurationSpace(space=[CS.Categorical("nes.population_size", (3, 64))])
    mine = Space("mine", dict(sizes.to_serialized_dict()))
    assert replace(study, space=mine).most_evaluations == 2 + 2 * 64
    assert (placed.workers_per_trial, placed.trials_on(capacity)) == (workers, trials)


def test_a_given_number_of_workers_stays(command: StudyCommand) -> None:
    assert replace(command, workers_per_trial=3).placed(Capacity(64)).workers_per_trial == 3
    few = replace(command, concurrent_trials=2)
    assert few.placed(Capacity(8)).workers_per_trial == 4


def test_it_asks_for_the_cores_that_it_can_use(command: StudyCommand) -> None:
    assert command.cores_wanted == 5
    assert replace(command, workers_per_trial=4).cores_wanted == 20
    assert replace(command, workers_per_trial=4, concurrent_trials=2).cores_wanted == 8
    endless = replace(command, brackets=1000)  # a cycle of its brackets
    assert endless.cores_wanted == 5


def test_a_quarter_of_the_time_is_for_validation() -> None:
    """But for what scoring the best SE takes."""
    assert deadlines(1000.0, 3660.0) == (1000.0 + 2700.0, 1000.0 + 3600.0)
    assert deadlines(0.0, 80.0) == (30.0, 40.0)
    assert deadlines(0.0, None) == (math.inf, math.inf)


def test_a_complete_study_gets_more_brackets_and_an_unfinished_one_completes_its_own(
    tmp_path: Path,
) -> None:
    study = make_study(tmp_path, brackets=3)
    journal, schedule = Journal(tmp_path), study.schedule

    def brackets(more: int, status: Status | None = "FINISHED", target: int = 3) -> int:
        run_status = None if status is None else RunStatus(status, 0.0, target)
        return brackets_to_reach(journal, schedule, more, run_status)

    assert brackets(2) == 5
    assert brackets(2, "KILLED") == 3
    assert brackets(2, "KILLED", target=4) == 4
    assert brackets(5, "KILLED") == 5
    assert brackets(2, None) == 5
    journal.results.pop()  # its time was over
    assert brackets(2) == 3
    assert brackets(4) == 4
    journal.configs.clear()
    journal.results.clear()
    assert brackets(2) == 2


def test_a_study_that_does_more_than_it_is_asked_says_so() -> None:
    told = more_than_asked(4, 2, unfinished=True)
    assert told == "it was begun with 4 brackets, and goes on with these"
    endless = more_than_asked(ENDLESS, 2, unfinished=True)
    assert endless is not None
    assert endless.startswith("it was begun without a number of brackets")
    assert more_than_asked(4, 4, unfinished=True) is None
    assert more_than_asked(4, 2, unfinished=False) is None  # a complete one has got two more

"""Every experiment, from its SEs to its pictures, on artificial results."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from cluster.experiments.experiment import Experiment
from cluster.experiments.figures import EXPERIMENTS
from cluster.experiments.style import column, svg
from tests.cluster.experiments.artificial import findings_of, material_of, smoke_plan

#: Acrobot has no TD3 agents, FrozenLake runs in gymnasium.
TASKS = ("CartPole-v0", "Acrobot-v1", "FrozenLake-v1")

experiments = pytest.mark.parametrize("experiment", EXPERIMENTS.values(), ids=list(EXPERIMENTS))


@pytest.fixture(scope="session")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home whose NES runs all tests share, as all experiments do."""
    return tmp_path_factory.mktemp("home")


@experiments
@pytest.mark.parametrize("task_id", TASKS)
def test_findings_are_complete(experiment: Experiment, task_id: str, home: Path) -> None:
    found = findings_of(experiment, home, task_id)
    assert len(found.data) > 0
    assert found.summary
    assert found.notes
    assert all(isinstance(value, float) for value in found.metrics.values())
    assert found.figures
    for figure in found.figures.values():
        picture = svg(figure)
        root = ElementTree.fromstring(picture)
        assert root.attrib["width"] == f"{72 * column(1).get_figwidth():g}pt"
        assert picture.count(b"<path") > 10


def test_equal_results_have_equal_picture_files(home: Path) -> None:
    first, second = (findings_of(EXPERIMENTS["transfer"], home).figures["td3"] for _ in range(2))
    assert svg(first) == svg(second)


def test_a_diverged_agent_scores_no_better_than_the_others(home: Path) -> None:
    """The worst score of a task with penalties may be above all scores."""
    transfer = EXPERIMENTS["transfer"]
    plan = smoke_plan(transfer)
    material = material_of(transfer, plan, home)
    first = next(iter(material.found))
    found = {
        key: replace(result, test_returns=(0.0 if key == first else -5.0,), finite=key != first)
        for key, result in material.found.items()
    }
    # The result of an agent of a larger size is ignored.
    found["another"] = replace(found[first], test_returns=(-300.0,), finite=True)
    data = transfer.conclude(plan, replace(material, found=found)).data
    assert set(data["score"]) == {-5.0}


@experiments
def test_evaluations_are_complete_and_unique(experiment: Experiment, home: Path) -> None:
    plan = smoke_plan(experiment)
    material = material_of(experiment, plan, home)
    evaluations = experiment.evaluations(plan, material)
    assert {one.key for one in evaluations} <= set(material.found)
    places = [(one.key, one.source.condition, one.source.number) for one in evaluations]
    assert len(set(places)) == len(places)

"""Every experiment, from its SEs to its pictures, on made-up results."""

import csv
import io
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from cluster.experiments.experiment import Experiment
from cluster.experiments.registry import EXPERIMENTS
from cluster.experiments.style import COLUMN, svg
from cluster.experiments.table import csv_bytes, text_lines
from cluster.storage.home import Home
from tests.cluster.experiments.made_up import findings_of, material_of, smoke_plan

#: The second one has an agent less, the third one runs in gymnasium.
TASKS = ("CartPole-v0", "Acrobot-v1", "MountainCar-v0")

experiments = pytest.mark.parametrize("experiment", EXPERIMENTS.values(), ids=list(EXPERIMENTS))


@pytest.fixture(scope="session")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home whose NES runs all tests share, as all experiments do."""
    return tmp_path_factory.mktemp("home")


@experiments
@pytest.mark.parametrize("task_id", TASKS)
def test_an_experiment_finds_something(experiment: Experiment, task_id: str, home: Path) -> None:
    found = findings_of(experiment, home, task_id)
    rows = list(csv.DictReader(io.StringIO(csv_bytes(found.data).decode())))
    assert len(rows) == len(found.data) > 0
    assert len(text_lines(found.summary)) == len(found.summary) + 1 > 1
    assert found.notes
    assert all(isinstance(value, float) for value in found.metrics.values())
    assert found.figures
    for figure in found.figures.values():
        picture = svg(figure)
        root = ElementTree.fromstring(picture)
        assert root.tag.endswith("svg")
        assert root.attrib["width"] == f"{72 * COLUMN:g}pt"
        assert b"<image" not in picture  # no pixels
        assert picture.count(b"<path") > 10


def test_a_picture_is_the_same_file_each_time(home: Path) -> None:
    once, again = (findings_of(EXPERIMENTS["transfer"], home).figures["td3"] for _ in range(2))
    assert svg(once) == svg(again)


def test_a_diverged_agent_is_no_better_than_the_others(home: Path) -> None:
    """The worst score of a task with penalties may lie above all that agents get."""
    transfer = EXPERIMENTS["transfer"]
    plan = smoke_plan(transfer)
    material = material_of(transfer, plan, Home(home))
    first = next(iter(material.found))
    found = {
        key: replace(result, test_returns=(0.0 if key == first else -5.0,), finite=key != first)
        for key, result in material.found.items()
    }
    # Of an agent that a larger size has trained, and this one does not ask for.
    found["another"] = replace(found[first], test_returns=(-300.0,), finite=True)
    rows = transfer.conclude(plan, replace(material, found=found)).data
    assert {row["score"] for row in rows} == {-5.0}


@experiments
def test_it_needs_no_agent_twice(experiment: Experiment, home: Path) -> None:
    """Asked again with all results, it asks for the same agents, once on each SE."""
    plan = smoke_plan(experiment)
    material = material_of(experiment, plan, Home(home))
    units = experiment.units(plan, material)
    assert {unit.key for unit in units} <= set(material.found)
    places = [(unit.key, unit.source.condition, unit.source.number) for unit in units]
    assert len(set(places)) == len(places)

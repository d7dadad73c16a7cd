"""After any failure, a study ends with the same results as an undisturbed one."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cluster.bohb.study.journal import Journal
from tests.faults import processes
from tests.faults.outcome import Outcome
from tests.faults.row import Row
from tests.faults.stage import ONE_BY_ONE, TRIAL, Stage

pytestmark = pytest.mark.timeout(590)


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    with Stage(tmp_path_factory.mktemp("stage"), brackets=1) as stage:
        yield stage


@pytest.fixture(scope="module")
def whole(stage: Stage) -> Outcome:
    """The outcome of an undisturbed study."""
    study = stage.study("whole", *ONE_BY_ONE)
    assert study.run() == 0, study.log.read_text()
    assert study.disagreements() == []
    return study.outcome()


def assert_nothing_can_be_told(row: Row) -> None:
    assert (row.lost, row.duplicated, row.mlflow) == (0, 0, [])
    assert row.identical
    assert row.exit_code == 0


def test_a_driver_killed_again_and_again(stage: Stage, whole: Outcome) -> None:
    """At random moments of one study; `python -m benchmarks.faults` does it twenty times."""
    row = processes.driver(stage, whole, 2, latest=5.0)
    assert row.injected >= 1  # the last one may come after the study's end
    assert_nothing_can_be_told(row)


def test_two_presses_of_ctrl_c_stop_at_once(stage: Stage, whole: Outcome) -> None:
    row = processes.ctrl_c(stage, whole, 1, presses=2)
    assert row.injected == 1
    assert_nothing_can_be_told(row)


def test_killed_trials_go_on_from_their_checkpoints(stage: Stage, whole: Outcome) -> None:
    row = processes.killed_children(stage, whole, TRIAL, "trial", 1)
    assert row.injected == 1
    assert_nothing_can_be_told(row)


def test_nodes_come_and_go(whole: Outcome, tmp_path: Path, database: Path) -> None:
    row = processes.nodes(tmp_path, whole, 1, brackets=1, database=database)
    assert row.injected >= 1
    assert_nothing_can_be_told(row)


def test_several_nodes_and_a_study_in_sqlite(stage: Stage) -> None:
    """A node that joins stops the study; with several nodes none begins."""
    told = "a cluster of 2 nodes cannot be tracked in 'sqlite:"
    study = stage.study("joined", *ONE_BY_ONE)
    nodes: list[Any] = []

    def join() -> None:
        if not nodes and (study.folder / "results.json").exists():
            nodes.append(stage.cluster.add_node(num_cpus=1))

    assert study.run(join) == 2
    assert told in study.log.read_text()
    assert len(Journal(study.folder).results) >= 1  # nothing is lost
    refused = stage.study("refused", *ONE_BY_ONE)
    assert refused.run() == 2
    stage.cluster.remove_node(nodes.pop())
    assert told in refused.log.read_text()
    assert not refused.home.folder.exists()

"""After any failure, a study ends with the same results as an undisturbed one."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cluster.bohb.study.journal import Journal
from tests.faults import processes
from tests.faults.outcome import Row
from tests.faults.stage import TRIAL, Stage

pytestmark = pytest.mark.timeout(590)


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    with Stage(tmp_path_factory.mktemp("stage"), brackets=1) as stage:
        yield stage


def assert_nothing_lost(row: Row) -> None:
    assert row.injected >= 1
    assert (row.lost, row.duplicated, row.mlflow) == (0, 0, [])
    assert row.identical
    assert row.exit_code == 0


def test_driver_killed_at_random_moments(stage: Stage) -> None:
    assert_nothing_lost(processes.driver(stage, 2, latest=5.0))


def test_two_presses_of_ctrl_c(stage: Stage) -> None:
    assert_nothing_lost(processes.ctrl_c(stage, 1, presses=2))


def test_killed_trials_resume_from_their_checkpoints(stage: Stage) -> None:
    assert_nothing_lost(processes.killed_children(stage, 1, TRIAL, "trial"))


def test_nodes_join_and_leave(stage: Stage, database: Path) -> None:
    assert_nothing_lost(processes.nodes(stage, 1, database=database))


def test_several_nodes_and_a_study_in_sqlite(stage: Stage) -> None:
    """A node that joins stops the study; with several nodes no study starts."""
    message = "a cluster of 2 nodes cannot be tracked in 'sqlite:"
    study = stage.study("joined")
    nodes: list[Any] = []

    def join() -> None:
        if not nodes and (study.folder / "results.json").exists():
            nodes.append(stage.cluster.add_node(num_cpus=1))

    assert study.run(join) == 2
    assert message in study.log.read_text()
    assert len(Journal(study.folder).results) >= 1
    refused = stage.study("refused")
    assert refused.run() == 2
    stage.cluster.remove_node(nodes.pop())
    assert message in refused.log.read_text()
    assert not refused.home.folder.exists()

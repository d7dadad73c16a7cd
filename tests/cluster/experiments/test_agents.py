"""Positions, digests and results of the experiments' agents."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from bilevel.agents import RegisteredAgent
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import default_agents
from bilevel.tasks import Task
from bilevel.version import RUN_FORMAT
from cluster.experiments.agents import AgentResults, Place, Source, Unit
from cluster.experiments.conditions import REAL
from cluster.experiments.run import RESULTS_FILE
from cluster.storage.run_folder import locked_settings
from tests.cluster.experiments.made_up import result_of
from tests.ses import make_se


@pytest.fixture
def ses(cartpole: Task) -> list[Source]:
    return [Source("default", i, make_se(cartpole, seed=i)) for i in range(2)]


def unit(task: Task, source: Source, place: Place, seed: int = 0, agent: str = "ddqn") -> Unit:
    (kind,) = default_agents((agent,))
    return Unit.of(task, source, place, kind, seed)


def test_an_agent_is_the_same_on_every_source(cartpole: Task, ses: list[Source]) -> None:
    on = [unit(cartpole, source, Place(3, 1)) for source in (*ses, Source(REAL))]
    assert len({(one.seed, one.hp) for one in on}) == 1
    assert len({one.key for one in on}) == 3
    others = [unit(cartpole, ses[0], Place(3, 2)), unit(cartpole, ses[0], Place(3, 1), seed=1)]
    assert len({(one.seed, one.hp) for one in (*on, *others)}) == 3


def test_agents_on_the_real_task_are_those_of_one_se_after_the_other() -> None:
    assert Place.on_real(12)[8:] == [Place(0, 8), Place(0, 9), Place(1, 0), Place(1, 1)]
    assert Place.on_real(400)[:30] == Place.on_real(30)


def test_the_key_tells_whatever_a_result_depends_on(cartpole: Task, ses: list[Source]) -> None:
    one = unit(cartpole, ses[0], Place(0, 0))
    changed = [
        unit(replace(cartpole, solved_reward=100.0), ses[0], Place(0, 0)),
        unit(cartpole, ses[0], Place(0, 0), agent="td3"),
        one.shorter(12),
    ]
    assert len({one.key, *(other.key for other in changed)}) == 4
    assert one.shorter(5000).key == one.key  # it trains no longer than it may
    # The label of a source is not part of it: the same SE under another name is the same.
    assert unit(cartpole, replace(ses[0], condition="varied", number=7), Place(0, 0)).key == one.key


def test_the_key_tells_another_version_of_users_code(
    cartpole: Task, ses: list[Source], monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = [unit(cartpole, ses[0], Place(0, 0)).key]
    for digest in ("one", "two"):
        monkeypatch.setattr(RegisteredAgent, "code_digest", digest)
        keys.append(unit(cartpole, ses[0], Place(0, 0)).key)
    assert len(set(keys)) == 3


def test_results_are_on_disk_at_once(tmp_path: Path, cartpole: Task, ses: list[Source]) -> None:
    units = [unit(cartpole, ses[0], Place(0, i)) for i in range(3)]
    results = AgentResults(tmp_path)
    for one in units[:2]:
        results.add(one, result_of(one))
    with (tmp_path / RESULTS_FILE).open("ab") as file:
        file.write(b'["cut')  # of a process that was killed
    again = AgentResults(tmp_path)
    assert again.found == {one.key: result_of(one) for one in units[:2]}
    again.add(units[2], result_of(units[2]))
    assert set(AgentResults(tmp_path).found) == {one.key for one in units}


def test_agents_of_other_experiments_are_not_trained_again(
    tmp_path: Path, cartpole: Task, ses: list[Source]
) -> None:
    """Unless another version of this package has trained them."""
    units = [unit(cartpole, ses[0], Place(0, i)) for i in range(4)]
    folders = [tmp_path / f"experiment-{name}-seed0" for name in ("cost", "transfer", "old")]
    for folder in folders:
        with locked_settings(folder, {"task": asdict(cartpole)}):
            pass
    old = folders[2] / "settings.json"
    old.write_text(old.read_text().replace(f'"format": {RUN_FORMAT}', '"format": 1'))
    cost, transfer, other = map(AgentResults, folders)
    for one in units[:2]:
        transfer.add(one, result_of(one))
    other.add(units[2], result_of(units[2]))
    cost.adopt(units[1:])
    assert set(cost.found) == {units[1].key}
    assert set(AgentResults(folders[0]).found) == {units[1].key}


def test_a_damaged_line_is_told(tmp_path: Path) -> None:
    (tmp_path / RESULTS_FILE).write_text('["key", {"score": 1}]\n')
    with pytest.raises(InvalidInput, match=r"results.jsonl', line 1"):
        AgentResults(tmp_path)


def test_an_se_with_another_architecture_is_another_one(cartpole: Task) -> None:
    """Also if its parameters are the same."""
    se = make_se(cartpole).se
    changes: list[dict[str, Any]] = [{}, {"step_limit": 5}, {"activation": "tanh"}]
    digests = {
        replace(se, architecture=replace(se.architecture, **other)).digest for other in changes
    }
    assert len(digests) == 3
    assert replace(se, psi=se.psi.copy()).digest in digests

"""Evaluations of the experiments: positions, keys and stored results."""

from dataclasses import replace
from pathlib import Path

import pytest

from bilevel.agents import get_agent
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import default_agents
from bilevel.tasks import Task
from cluster.experiments.conditions import REAL
from cluster.experiments.experiment import Evaluation, Plan, Source
from cluster.experiments.run import RESULTS_FILE, AgentResults
from cluster.experiments.sizes import SIZES
from tests.cluster.experiments.artificial import result_of
from tests.ses import make_se


@pytest.fixture
def plan(cartpole: Task) -> Plan:
    return Plan(cartpole, SIZES["local"], default_agents(("ddqn",)), 0)


@pytest.fixture
def sources(cartpole: Task) -> list[Source]:
    ses = [Source("default", i, make_se(cartpole, seed=i)) for i in range(2)]
    return [*ses, Source(REAL)]


@pytest.fixture
def evaluations(plan: Plan, sources: list[Source]) -> list[Evaluation]:
    """Four agents on one SE."""
    return plan.evaluations(sources[:1], plan.kinds, 4)


def test_equal_positions_have_equal_agents_on_every_source(
    plan: Plan, sources: list[Source]
) -> None:
    found = plan.evaluations(sources, plan.kinds, 10, on_real=12)
    by_position: dict[str, set[object]] = {}
    for one in found:
        by_position.setdefault(one.position, set()).add((one.seed, one.hp))
    assert [len(agents) for agents in by_position.values()] == [1] * 20
    assert len({one.key for one in found}) == len(found) == 32
    assert [one.position for one in found[-3:]] == ["0-9", "1-0", "1-1"]  # on the real task
    other = replace(plan, seed=1).evaluations(sources, plan.kinds, 10)
    assert not {one.seed for one in found} & {one.seed for one in other}


def test_key_covers_everything_that_a_result_depends_on(
    cartpole: Task, evaluations: list[Evaluation], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = evaluations[0]
    (td3,) = default_agents(("td3",))
    changed = [
        replace(one, task=replace(cartpole, solved_reward=100.0)),
        replace(one, hp=td3),
        replace(one, seed=1),
        replace(one, hp=replace(one.hp, max_episodes=12)),
    ]
    assert len({one.key, *(other.key for other in changed)}) == 5
    source = replace(one.source, condition="varied", number=7)
    assert replace(one, source=source).key == one.key  # the label of an SE has no effect
    monkeypatch.setitem(vars(get_agent(one.hp.agent)), "code_digest", "custom code")
    assert replace(one).key != one.key


def test_results_survive_a_kill(tmp_path: Path, evaluations: list[Evaluation]) -> None:
    results = AgentResults(tmp_path)
    for one in evaluations[:2]:
        results.add(one.key, result_of(one))
    with (tmp_path / RESULTS_FILE).open("ab") as file:
        file.write(b'["cut')  # an unfinished line
    again = AgentResults(tmp_path)
    assert again.found == {one.key: result_of(one) for one in evaluations[:2]}
    again.add(evaluations[2].key, result_of(evaluations[2]))
    assert set(AgentResults(tmp_path).found) == {one.key for one in evaluations[:3]}


def test_experiments_share_results(tmp_path: Path, evaluations: list[Evaluation]) -> None:
    cost, transfer = (
        AgentResults(tmp_path / f"experiment-{name}") for name in ("cost", "transfer")
    )
    for one in evaluations[:2]:
        transfer.add(one.key, result_of(one))
    cost.adopt(one.key for one in evaluations[1:])
    assert set(cost.found) == {evaluations[1].key}
    assert AgentResults(tmp_path / "experiment-cost").found == cost.found


def test_damaged_results_are_invalid(tmp_path: Path) -> None:
    (tmp_path / RESULTS_FILE).write_text('["key", {"score": 1}]\n')
    with pytest.raises(InvalidInput, match=r"results.jsonl', line 1"):
        AgentResults(tmp_path)

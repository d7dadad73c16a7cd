"""One conformance suite for every agent: the built-in ones, and the example of docs/agents.md."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
import torch
from pydantic import Field

from bilevel import InvalidInput
from bilevel.agents import agent as registry
from bilevel.agents import get_agent, register_agent, registered_agents
from bilevel.agents.variation import draw_agent
from bilevel.durable import checksum
from bilevel.evaluation import train_and_test
from bilevel.evaluation.run import environment_in_python
from bilevel.hyperparameters import (
    AgentHyperparameters,
    DDQNHyperparameters,
    default_agents,
    load_recipe,
)
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.nes import NES
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task, get_task
from bilevel.user_code import mistake_at
from cluster.ray.agent_files import load_agent_file
from search_spaces.bohb import search_space
from tests.agent_files import forgotten_afterwards
from tests.conftest import restored
from tests.documents import documented_agent

AGENTS = ("ddqn", "dueling-ddqn", "td3", "reinforce")


@pytest.fixture(scope="module", autouse=True)
def _documented_agent(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with forgotten_afterwards():
        file = tmp_path_factory.mktemp("agents") / "reinforce.py"
        file.write_text(documented_agent())
        load_agent_file(file)
        yield


def small(name: str, **changes: Any) -> Any:
    (hp,) = default_agents((name,))
    sizes = {"max_episodes": 14, "init_episodes": 2, "hidden_size": 8, "batch_size": 16}
    known = {spec.name for spec in fields(hp)}
    return replace(hp, **({k: v for k, v in sizes.items() if k in known} | changes))


@pytest.fixture
def se(cartpole: Task) -> SE:
    hp = load_recipe("paper", "CartPole-v0").se
    architecture = Architecture.of(cartpole, replace(hp, hidden_size=8))
    return SE(architecture, architecture.initialize(np.random.default_rng(0)))


def test_all_agents_are_registered() -> None:
    assert set(AGENTS) <= set(registered_agents())


@pytest.mark.parametrize("name", AGENTS)
class TestEveryAgent:
    def test_an_evaluation_depends_on_its_request_alone(self, name: str, se: Any) -> None:
        task, hp = get_task("CartPole-v0"), small(name)
        one = train_and_test(task, se, hp, 7)
        np.random.seed(3)
        torch.manual_seed(3)
        two = train_and_test(task, se, hp, 7)
        assert one == two
        assert train_and_test(task, se, hp, 8).train_steps > 0
        assert one.finite
        assert len(one.test_returns) == hp.test_episodes

    def test_kernel_and_definition_agree_on_a_whole_evaluation(self, name: str, se: Any) -> None:
        task, hp = get_task("CartPole-v0"), small(name, max_episodes=12, test_episodes=3)
        fast = train_and_test(task, se, hp, 7)
        slow = train_and_test(task, se, hp, 7, compiled=False)
        assert fast == slow

    def test_trains_on_the_real_task(self, name: str) -> None:
        outcome = train_and_test(get_task("CartPole-v0"), None, small(name, max_episodes=4), 1)
        assert outcome.train_episodes == 4
        assert all(1 <= value <= 200 for value in outcome.test_returns)

    def test_trains_on_a_real_task_that_gymnasium_runs(self, name: str) -> None:
        hp = small(name, max_episodes=2, test_episodes=1)
        outcome = train_and_test(get_task("MountainCar-v0"), None, hp, 1)
        assert outcome == train_and_test(get_task("MountainCar-v0"), None, hp, 1)
        assert outcome.train_steps == 400

    def test_numbers_that_diverge_score_worst(self, name: str, acrobot: Task, se: Any) -> None:
        architecture = replace(se.architecture, state_size=6, n_actions=3)
        psi = np.full(architecture.parameter_count, 1e20, np.float32)
        outcome = train_and_test(acrobot, SE(architecture, psi), small(name), 0)
        assert not outcome.finite
        assert set(outcome.test_returns) == {-500.0}

    def test_hyperparameters_vary_and_are_searched(self, name: str) -> None:
        hp = small(name)
        drawn = [draw_agent((hp,), "all", seed) for seed in range(5)]
        assert len({vars(agent)["learning_rate"] for agent in drawn}) == 5
        assert f"{name}.learning_rate" in search_space("full", (name,))

    def test_hyperparameters_survive_json(self, name: str) -> None:
        hp = load_recipe("paper", "", (name,))
        assert restored(hp.to_dict()) == hp
        with pytest.raises(InvalidInput, match="max_episodes"):
            replace(hp.agents[0], max_episodes=0)


def test_a_mixture_draws_an_agent_an_evaluation(cartpole: Task) -> None:
    hp = load_recipe("paper", cartpole.id, AGENTS)
    nes = NES(cartpole, hp, 0)
    kinds = [request.agent.agent for request in nes.ask(nes.init())]
    assert set(kinds) == set(AGENTS)


def test_an_agent_without_a_name_or_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="unknown agent 'sarsa': allowed are ddqn"):
        get_agent("sarsa")
    broken = tmp_path / "broken_agent.py"
    broken.write_text("import nothing_of_that_name")
    with pytest.raises(InvalidInput, match=r"broken_agent.*nothing_of_that_name"):
        load_agent_file(broken)
    leaving = tmp_path / "leaving_agent.py"
    leaving.write_text("raise SystemExit('no licence')")
    with pytest.raises(InvalidInput, match=r"leaving_agent.py': SystemExit: no licence"):
        load_agent_file(leaving)
    for name in ("json", "antigravity"):  # the latter would open a browser
        twice = tmp_path / f"{name}.py"
        twice.write_text("")
        with pytest.raises(InvalidInput, match=f"name of another module, .*{name}.*: rename it"):
            load_agent_file(twice)
    useless = tmp_path / "useless_agent.py"
    useless.write_text("from bilevel.agents import register_agent")
    with pytest.raises(InvalidInput, match=r"useless_agent.py' registers no agent: end it with re"):
        load_agent_file(useless)
    with pytest.raises(InvalidInput, match=r"must be a Python file"):
        load_agent_file(tmp_path / "not-a-module.py")


def test_code_of_the_users_own_has_a_digest(tmp_path: Path) -> None:
    """Of the file's content as it was imported; built-in agents change with the version alone."""
    file = tmp_path / "digested_agent.py"
    code = documented_agent().replace('agent="reinforce"', 'agent="digested"')
    file.write_text(code)
    assert load_agent_file(file) == ("digested",)
    digest = get_agent("digested").code_digest
    assert digest is not None
    assert digest == checksum(code.encode())[:16]
    file.write_text("changed")
    registry._code_digest.cache_clear()
    assert get_agent("digested").code_digest == digest
    assert [get_agent(name).code_digest for name in AGENTS[:3]] == [None, None, None]


def test_a_mistake_is_told_with_the_line_that_was_imported(tmp_path: Path) -> None:
    file = tmp_path / "edited_agent.py"
    file.write_text(documented_agent().replace('agent="reinforce"', 'agent="edited"'))
    load_agent_file(file)
    agent = type(get_agent("edited").build(small("edited"), 4, 2, 0))
    before = str(mistake_at("agent 'edited'", agent, "is wrong"))
    file.write_text("\n\n" + file.read_text())
    assert str(mistake_at("agent 'edited'", agent, "is wrong")) == before
    assert str(file) in before


def test_annotations_may_be_strings(tmp_path: Path) -> None:
    """As they are under `from __future__ import annotations`."""
    code = documented_agent().replace('agent="reinforce"', 'agent="postponed-reinforce"')
    docstring, newline, rest = code.partition("\n")
    file = tmp_path / "postponed_agent.py"
    file.write_text(f"{docstring}{newline}from __future__ import annotations\n{rest}")
    load_agent_file(file)
    (hp,) = default_agents(("postponed-reinforce",))
    assert replace(hp, hidden_size=3) != hp  # type: ignore[call-arg]
    with pytest.raises(InvalidInput, match=r"postponed-reinforce\.hidden_size must be int, 1 to"):
        replace(hp, hidden_size="3")  # type: ignore[call-arg]


@pytest.mark.parametrize("on_se", [True, False])
def test_an_agent_that_changes_its_state_does_not_change_the_environment(
    on_se: bool, se: SE, cartpole: Task
) -> None:
    seen = []
    for factor in (1.0, 0.5):
        with environment_in_python(cartpole, se if on_se else None, 3, 0) as env:
            rewards, states = [], [env.reset(0)]
            for _ in range(4):
                states[-1] *= factor
                state, reward, _, _ = env.step(1)
                states.append(state)
                rewards.append(reward)
        seen.append((rewards, states[-1]))
    assert seen[0][0] == seen[1][0]
    np.testing.assert_array_equal(seen[0][1], seen[1][1])


def test_a_value_without_a_type_is_refused() -> None:
    """It would be no field, and neither be varied nor stored."""
    with pytest.raises(InvalidInput, match=r"Untyped.learning_rate has no type.* Annotated\[float"):

        @hyperparameters
        class Untyped(AgentHyperparameters):
            learning_rate = 0.01


def test_hyperparameters_that_nothing_checks_are_refused() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Unchecked(AgentHyperparameters):
        learning_rate: float = 1.0

    with pytest.raises(InvalidInput, match="Unchecked must be decorated with `hyperparameters`"):
        register_agent(Unchecked, lambda *_: None)  # type: ignore[arg-type]


@pytest.mark.parametrize("rule", [{"ge": 1, "lt": 64}, {"ge": 1, "le": 64, "multiple_of": 8}])
def test_a_range_that_drawn_values_could_leave_is_refused(rule: dict[str, int]) -> None:
    @hyperparameters
    class Choosy(AgentHyperparameters, agent=f"choosy{len(rule)}"):
        """Its sizes are drawn."""

        hidden_size: Annotated[int, Field(**rule)] = 8

    with pytest.raises(InvalidInput, match=r"Choosy.hidden_size is varied, .* `Field\(ge=..., le="):
        register_agent(Choosy, lambda *_: None)  # type: ignore[arg-type]


def test_an_agent_names_itself_and_no_other_agent() -> None:
    @hyperparameters
    class Heir(DDQNHyperparameters):
        """Without a name of its own: it would replace DDQN."""

    @hyperparameters
    class Nameless(AgentHyperparameters):
        """Without any name."""

    for kind in (Heir, Nameless):
        with pytest.raises(InvalidInput, match=f"{kind.__name__} must name its agent"):
            register_agent(kind, lambda *_: None)  # type: ignore[arg-type]
    assert get_agent("ddqn").build_kernel is not None
    for name in ("my agent", "my.agent", "a,b", "nes", "vary_agent"):  # a recipe could not have it
        with pytest.raises(InvalidInput, match=f"the agent name '{name}' is not allowed"):
            type("Mine", (AgentHyperparameters,), {}, agent=name)
    with pytest.raises(InvalidInput, match="the agent name 'ddqn' is taken by"):

        class Usurper(AgentHyperparameters, agent="ddqn"):
            """With the name of another."""


def test_entry_points_of_installed_packages_are_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real distribution on the path, as pip installs it."""
    info = tmp_path / "my_agents-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-agents\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[bilevel.agents]\nmine = my_agents_module\n")
    code = documented_agent().replace('agent="reinforce"', 'agent="installed-reinforce"')
    (tmp_path / "my_agents_module.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert get_agent("installed-reinforce").name == "installed-reinforce"
    monkeypatch.delitem(registry._AGENTS, "installed-reinforce")
    (info / "entry_points.txt").write_text("[bilevel.agents]\nmine = nothing_of_that_name\n")
    told = r"installed agent 'mine' \(nothing_of_that_name\) cannot be imported: ModuleNotFound"
    with pytest.raises(InvalidInput, match=told):
        get_agent("sarsa")

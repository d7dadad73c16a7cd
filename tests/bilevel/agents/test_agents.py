"""One conformance suite for every agent: the built-in ones, and the example of docs/agents.md."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bilevel import InvalidInput
from bilevel.agents import get_agent, register_agent, registered_agents
from bilevel.agents.environments import environment_in_python
from bilevel.agents.variation import draw_agent
from bilevel.durable import checksum
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import AgentHyperparameters, DDQNHyperparameters, default_agents
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.synthetic_env import SE
from bilevel.tasks import Task
from cluster.ray.agent_files import load_agent_file
from search_spaces.bohb import search_space
from tests.agent_files import forgotten_afterwards
from tests.documents import documented_agent
from tests.ses import make_se

AGENTS = ("ddqn", "dueling-ddqn", "td3", "ppo", "reinforce")


@pytest.fixture(scope="module", autouse=True)
def _documented_agent(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with forgotten_afterwards():
        write_agent(tmp_path_factory.mktemp("agents") / "reinforce.py", "reinforce")
        yield


def write_agent(file: Path, name: str) -> str:
    """Write the documented agent to a file under another name, and load it; return its code."""
    code = documented_agent().replace('agent="reinforce"', f'agent="{name}"')
    file.write_text(code)
    load_agent_file(file)
    assert name in registered_agents()
    return code


def small(name: str, **changes: Any) -> Any:
    (hp,) = default_agents((name,))
    sizes = {"max_episodes": 14, "init_episodes": 2, "hidden_size": 8, "batch_size": 16}
    known = {spec.name for spec in fields(hp)}
    return replace(hp, **({k: v for k, v in sizes.items() if k in known} | changes))


@pytest.fixture
def se(cartpole: Task) -> SE:
    return make_se(cartpole).se


@pytest.mark.parametrize("name", AGENTS)
class TestEveryAgent:
    def test_an_evaluation_depends_on_its_request_only(
        self, name: str, se: SE, cartpole: Task
    ) -> None:
        hp = small(name)
        first = train_and_test(cartpole, se, hp, 7)
        np.random.seed(3)
        torch.manual_seed(3)
        assert train_and_test(cartpole, se, hp, 7) == first
        assert train_and_test(cartpole, se, hp, 8) != first
        assert first.finite
        assert len(first.test_returns) == hp.test_episodes

    def test_kernel_and_definition_agree_on_a_whole_evaluation(
        self, name: str, se: SE, cartpole: Task
    ) -> None:
        hp = small(name, max_episodes=12, test_episodes=3)
        fast = train_and_test(cartpole, se, hp, 7)
        assert train_and_test(cartpole, se, hp, 7, compiled=False) == fast

    def test_hyperparameters_vary_and_are_searched(self, name: str) -> None:
        drawn = [draw_agent((small(name),), "all", seed) for seed in range(5)]
        assert len({vars(agent)["learning_rate"] for agent in drawn}) == 5
        assert f"{name}.learning_rate" in search_space("full", (name,))


@pytest.mark.parametrize(
    ("name", "code", "message"),
    [
        ("broken_agent.py", "import no_such_module", "broken_agent.*no_such_module"),
        ("exiting_agent.py", "raise SystemExit('no licence')", "SystemExit: no licence"),
        ("json.py", "", "name of another module, .*json.*: rename it"),
        ("antigravity.py", "", "name of another module"),  # importing that would open a browser
        ("useless_agent.py", "import numpy", "registers no agent: end it with re"),
    ],
)
def test_invalid_agent_files_are_rejected(
    tmp_path: Path, name: str, code: str, message: str
) -> None:
    file = tmp_path / name
    file.write_text(code)
    with pytest.raises(InvalidInput, match=message):
        load_agent_file(file)


def test_an_unknown_agent_is_rejected() -> None:
    with pytest.raises(InvalidInput, match="unknown agent 'sarsa': allowed are ddqn"):
        get_agent("sarsa")


def test_digests_are_those_of_the_imported_code(tmp_path: Path) -> None:
    """Even if the file has changed since then."""
    file = tmp_path / "digested_agent.py"
    code = write_agent(file, "digested")
    file.write_text("\n\n" + code)
    assert get_agent("digested").code_digest == checksum(code.encode())[:16]
    assert [get_agent(name).code_digest for name in AGENTS[:3]] == [None, None, None]


def test_annotations_may_be_strings(tmp_path: Path) -> None:
    """`from __future__ import annotations` makes them strings."""
    code = documented_agent().replace('agent="reinforce"', 'agent="postponed-reinforce"')
    docstring, newline, rest = code.partition("\n")
    file = tmp_path / "postponed_agent.py"
    file.write_text(f"{docstring}{newline}from __future__ import annotations\n{rest}")
    load_agent_file(file)
    (hp,) = default_agents(("postponed-reinforce",))
    assert replace(hp, hidden_size=3) != hp  # type: ignore[call-arg]
    with pytest.raises(
        InvalidInput, match=r"postponed-reinforce\.hidden_size: must be a valid integer"
    ):
        replace(hp, hidden_size="3")  # type: ignore[call-arg]


@pytest.mark.parametrize("on_se", [True, False])
def test_agents_cannot_change_the_state_of_the_environment(
    on_se: bool, se: SE, cartpole: Task
) -> None:
    trajectories = []
    for factor in (1.0, 0.5):
        with environment_in_python(cartpole, se if on_se else None, 3, 0) as env:
            state, rewards = env.reset(0), []
            for _ in range(4):
                state *= factor
                state, reward, _, _ = env.step(1)
                rewards.append(reward)
            trajectories.append([*state, *rewards])
    assert trajectories[0] == trajectories[1]


def test_hyperparameters_need_their_decorator() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Unchecked(AgentHyperparameters):
        learning_rate: float = 1.0

    with pytest.raises(InvalidInput, match="Unchecked must be decorated with `hyperparameters`"):
        register_agent(Unchecked, lambda *_: None)  # type: ignore[arg-type]


def test_an_agent_needs_a_unique_name() -> None:
    @hyperparameters
    class Unnamed(DDQNHyperparameters):
        """Inherits the name of DDQN."""

    with pytest.raises(InvalidInput, match="Unnamed must name its agent"):
        register_agent(Unnamed, lambda *_: None)  # type: ignore[arg-type]
    assert get_agent("ddqn").build_kernel is not None
    for name in ("my agent", "my.agent", "a,b", "nes", "vary_agent"):  # not possible in a recipe
        with pytest.raises(InvalidInput, match=f"the agent name '{name}' is not allowed"):
            type("Mine", (AgentHyperparameters,), {}, agent=name)
    with pytest.raises(InvalidInput, match="the agent name 'ddqn' is taken by"):
        type("Mine", (AgentHyperparameters,), {}, agent="ddqn")


def test_entry_points_of_installed_packages_are_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A distribution on the path, as pip installs it."""
    info = tmp_path / "my_agents-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-agents\nVersion: 1.0\n")
    entry_points = info / "entry_points.txt"
    entry_points.write_text("[bilevel.agents]\nmine = my_agents_module\n")
    code = documented_agent().replace('agent="reinforce"', 'agent="installed-reinforce"')
    (tmp_path / "my_agents_module.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert get_agent("installed-reinforce").name == "installed-reinforce"
    entry_points.write_text("[bilevel.agents]\nmine = no_such_module\n")
    message = r"installed agent 'mine' \(no_such_module\) cannot be imported: ModuleNotFound"
    with pytest.raises(InvalidInput, match=message):
        get_agent("sarsa")

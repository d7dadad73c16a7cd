"""Agents are drawn from the paper's ranges, and depend on the seed alone."""

from dataclasses import fields, replace
from typing import Annotated, Any, cast

import numpy as np
import pytest
from pydantic import Field
from scipy.stats import chisquare, kstest

from bilevel import InvalidInput
from bilevel.agents.variation import NARROWEST, SMALL, draw_agent
from bilevel.hyperparameters import AgentHyperparameters, DDQNHyperparameters
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.recipes import load_recipe
from tests.conftest import ddqn

SAMPLES = 300


@pytest.mark.parametrize("name", ["ddqn", "dueling-ddqn", "td3"])
def test_small_agents_are_the_cheap_ones_of_the_paper(name: str) -> None:
    agents = load_recipe("default", "CartPole-v0", agents=(name,)).agents
    drawn = [draw_agent(agents, "small", seed) for seed in range(4 * SAMPLES)]
    costs = np.array([hp.step_cost for hp in drawn])
    # Few deep agents are small; if no small one is drawn, the cheapest is taken.
    assert np.median(costs) <= SMALL
    assert costs.max() <= 4 * SMALL
    depths = [vars(hp)["hidden_layers"] for hp in drawn]
    assert chisquare([depths.count(layers) for layers in (1, 2, 3)]).pvalue > 1e-3
    rates = np.log([vars(hp)["learning_rate"] for hp in drawn])
    assert kstest((rates - rates.min()) / np.ptp(rates), "uniform").pvalue > 1e-3
    assert drawn[7] == draw_agent(agents, "small", 7)


@pytest.mark.parametrize("name", ["ddqn", "dueling-ddqn", "td3"])
def test_narrowed_agents_stand_for_those_of_all_sizes(name: str) -> None:
    """Same draw, so few units that it is small, and a learning rate higher by as much."""
    agents = load_recipe("default", "CartPole-v0", agents=(name,)).agents
    widths = []
    for seed in range(SAMPLES):
        whole, narrow = (vars(draw_agent(agents, vary, seed)) for vary in ("all", "narrowed"))
        cost = draw_agent(agents, "narrowed", seed).step_cost
        if draw_agent(agents, "all", seed).step_cost <= SMALL:
            assert narrow == whole
            continue
        assert cost <= SMALL or (narrow["hidden_size"], narrow["batch_size"]) == (NARROWEST, 42)
        assert NARROWEST <= narrow["hidden_size"] < whole["hidden_size"]
        if narrow["hidden_size"] > NARROWEST:  # one unit more would be too many
            assert narrow["batch_size"] == whole["batch_size"]
            agent = cast(Any, draw_agent(agents, "narrowed", seed))
            assert replace(agent, hidden_size=agent.hidden_size + 1).step_cost > SMALL
        speed = narrow["learning_rate"] / whole["learning_rate"]
        assert speed**2 == pytest.approx(whole["hidden_size"] / narrow["hidden_size"])
        assert narrow["hidden_layers"] == whole["hidden_layers"]
        widths.append(narrow["hidden_size"])
    assert len(widths) > SAMPLES / 2


@pytest.mark.parametrize("vary", ["small", "narrowed"])
def test_an_agent_of_unknown_cost_is_drawn_all_the_same(vary: str) -> None:
    assert draw_agent((AgentHyperparameters(),), vary, 0) == AgentHyperparameters()


@hyperparameters
class Uncounted(AgentHyperparameters, agent="uncounted"):
    """An agent of a user's own, which does not tell what its sizes cost."""

    learning_rate: Annotated[float, Field(ge=1e-8, le=1.0)] = 0.3
    hidden_size: Annotated[int, Field(ge=1, le=4096)] = 64
    batch_size: Annotated[int, Field(ge=1, le=4096)] = 64


def test_an_agent_whose_sizes_cost_nothing_is_not_narrowed() -> None:
    agents = (Uncounted(),)
    for seed in range(20):
        assert draw_agent(agents, "narrowed", seed) == draw_agent(agents, "all", seed)


def test_another_variation_is_refused() -> None:
    agents = load_recipe("default", "CartPole-v0").agents
    with pytest.raises(InvalidInput, match="allowed are no, small, narrowed, all"):
        draw_agent(agents, "some", 0)


def test_ranges_of_the_paper() -> None:
    agent = ddqn(load_recipe("default", "CartPole-v0"))
    agents = [draw_agent((agent,), "all", seed) for seed in range(SAMPLES)]
    for name, low, high in (
        ("learning_rate", 1e-3 / 3, 3e-3),
        ("batch_size", 42, 384),
        ("hidden_size", 42, 384),
        ("hidden_layers", 1, 3),
    ):
        values = [getattr(a, name) for a in agents]
        assert low <= min(values) < max(values) <= high
    assert {vars(a)["hidden_layers"] for a in agents} == {1, 2, 3}
    sizes = np.log([vars(a)["hidden_size"] for a in agents])
    uniform = (sizes - np.log(42)) / np.log(384 / 42)
    assert kstest(uniform, "uniform").pvalue > 1e-3


def test_only_four_are_varied_and_only_by_the_seed(small_agent: DDQNHyperparameters) -> None:
    one, two = (draw_agent((small_agent,), "all", 2**63 + 5) for _ in range(2))
    assert one == two
    varied = {"learning_rate", "batch_size", "hidden_size", "hidden_layers"}
    for spec in fields(small_agent):
        if spec.name not in varied:
            assert getattr(one, spec.name) == getattr(small_agent, spec.name)


@hyperparameters
class Narrow(AgentHyperparameters, agent="test-narrow"):
    """An agent with ranges of its own, inside of and beside the paper's."""

    learning_rate: Annotated[float, Field(ge=0.0, le=2e-3)] = 1e-3
    batch_size: Annotated[int, Field(ge=100, le=5000)] = 128
    hidden_size: Annotated[int, Field(ge=64, le=128)] = 64

    @property
    def step_cost(self) -> float:
        return 10.0 * self.batch_size * self.hidden_size


@pytest.mark.parametrize("vary", ["all", "small", "narrowed"])
def test_an_agents_own_ranges_are_kept(vary: str) -> None:
    drawn = [draw_agent((Narrow(),), vary, seed) for seed in range(100)]
    sizes = {vars(hp)["hidden_size"] for hp in drawn}
    assert min(sizes) == 64
    assert vary == "narrowed" or max(sizes) == 128
    assert min(vars(hp)["batch_size"] for hp in drawn) == 100
    assert max(vars(hp)["learning_rate"] for hp in drawn) == 2e-3


def test_several_agents_are_drawn_about_equally() -> None:
    hp = load_recipe("default", "CartPole-v0", agents=("ddqn", "dueling-ddqn", "td3"))
    names = [draw_agent(hp.agents, "all", seed).agent for seed in range(300)]
    assert all(70 < names.count(name) < 130 for name in ("ddqn", "dueling-ddqn", "td3"))
    rates = [vars(draw_agent(hp.agents[2:], "all", s))["learning_rate"] for s in range(100)]
    assert 5e-4 / 3 <= min(rates) < max(rates) <= 15e-4

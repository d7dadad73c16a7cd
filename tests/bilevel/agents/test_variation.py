"""Agents are drawn from the paper's ranges, and depend on the seed alone."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from bilevel import InvalidInput
from bilevel.agents.variation import SMALL, draw_agent
from bilevel.hyperparameters import AgentHyperparameters, DDQNHyperparameters, load_recipe
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


def test_an_agent_of_unknown_cost_is_drawn_all_the_same() -> None:
    assert draw_agent((AgentHyperparameters(),), "small", 0) == AgentHyperparameters()


def test_another_variation_is_refused() -> None:
    agents = load_recipe("default", "CartPole-v0").agents
    with pytest.raises(InvalidInput, match="allowed are no, small, all"):
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

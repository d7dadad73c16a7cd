"""Agents are drawn from the paper's ranges, and depend only on the seed."""

from dataclasses import fields, replace
from typing import Annotated, Any, cast

import numpy as np
import pytest
from pydantic import Field
from scipy.stats import chisquare, kstest

from bilevel.agents.variation import NARROWEST, SMALL, VARIED, draw_agent
from bilevel.hyperparameters import AgentHyperparameters, default_agents
from bilevel.hyperparameters.validation import hyperparameters

BUILT_IN = ("ddqn", "dueling-ddqn", "td3", "ppo")
SAMPLES = 300


def draw(name: str, vary: str, samples: int = SAMPLES) -> list[Any]:
    agents = default_agents((name,))
    return [draw_agent(agents, vary, seed) for seed in range(samples)]


@pytest.mark.parametrize(("name", "rate"), [("ddqn", 1e-3), ("dueling-ddqn", 1e-3), ("td3", 5e-4)])
def test_ranges_of_the_paper(name: str, rate: float) -> None:
    drawn = draw(name, "all")
    for field, low, high in (
        ("learning_rate", rate / 3, rate * 3),
        ("batch_size", 42, 384),
        ("hidden_size", 42, 384),
    ):
        values = np.array([getattr(hp, field) for hp in drawn])
        assert low <= values.min() < values.max() <= high
        assert kstest(np.log(values / low) / np.log(high / low), "uniform").pvalue > 1e-3
    assert {hp.hidden_layers for hp in drawn} == {1, 2, 3}
    (original,) = default_agents((name,))
    unvaried = [spec.name for spec in fields(original) if spec.name not in VARIED]
    assert all(getattr(drawn[0], field) == getattr(original, field) for field in unvaried)
    assert drawn[7] == draw_agent((original,), "all", 7)


@pytest.mark.parametrize("name", BUILT_IN)
def test_small_agents_are_cheap_and_of_all_depths(name: str) -> None:
    drawn = draw(name, "small", 4 * SAMPLES)
    costs = np.array([hp.step_cost for hp in drawn])
    # Few deep agents are small; if no draw is small, the cheapest is taken.
    assert np.median(costs) <= SMALL
    assert costs.max() <= 4 * SMALL
    depths = [hp.hidden_layers for hp in drawn]
    assert chisquare([depths.count(layers) for layers in (1, 2, 3)]).pvalue > 1e-3
    rates = np.log([hp.learning_rate for hp in drawn])
    assert kstest((rates - rates.min()) / np.ptp(rates), "uniform").pvalue > 1e-3


@pytest.mark.parametrize("name", BUILT_IN)
def test_narrowed_agents_replace_large_ones(name: str) -> None:
    """With the largest width that is small, and a learning rate that grows accordingly."""
    replaced = 0
    for whole, narrow in zip(draw(name, "all"), draw(name, "narrowed"), strict=True):
        if whole.step_cost <= SMALL:
            assert narrow == whole
            continue
        replaced += 1
        assert NARROWEST <= narrow.hidden_size < whole.hidden_size
        assert narrow.step_cost <= SMALL or (narrow.hidden_size, narrow.batch_size) == (16, 42)
        if narrow.hidden_size > NARROWEST:
            assert narrow.batch_size == whole.batch_size
            assert replace(narrow, hidden_size=narrow.hidden_size + 1).step_cost > SMALL
        speed = narrow.learning_rate / whole.learning_rate
        assert speed**2 == pytest.approx(whole.hidden_size / narrow.hidden_size)
        assert narrow.hidden_layers == whole.hidden_layers
    assert replaced > SAMPLES / 3


@hyperparameters
class Uncounted(AgentHyperparameters, agent="uncounted"):
    """A user's agent whose `step_cost` ignores its sizes."""

    learning_rate: Annotated[float, Field(ge=1e-8, le=1.0)] = 0.3
    hidden_size: Annotated[int, Field(ge=1, le=4096)] = 64
    batch_size: Annotated[int, Field(ge=1, le=4096)] = 64


@pytest.mark.parametrize("hp", [AgentHyperparameters(), Uncounted()])
def test_an_agent_of_unknown_cost_is_never_narrowed(hp: AgentHyperparameters) -> None:
    for seed in range(20):
        whole, small, narrow = (draw_agent((hp,), v, seed) for v in ("all", "small", "narrowed"))
        assert narrow == whole
        assert fields(small) == fields(hp)


@hyperparameters
class Narrow(AgentHyperparameters, agent="test-narrow"):
    """An agent whose ranges are narrower than, or outside of, the paper's."""

    learning_rate: Annotated[float, Field(ge=0.0, le=2e-3)] = 1e-3
    batch_size: Annotated[int, Field(ge=100, le=5000)] = 128
    hidden_size: Annotated[int, Field(ge=64, le=128)] = 64

    @property
    def step_cost(self) -> float:
        return 10.0 * self.batch_size * self.hidden_size


@pytest.mark.parametrize("vary", ["all", "small", "narrowed"])
def test_an_agents_ranges_are_respected(vary: str) -> None:
    drawn = [cast(Any, draw_agent((Narrow(),), vary, seed)) for seed in range(100)]
    sizes = {hp.hidden_size for hp in drawn}
    assert min(sizes) == 64
    assert vary == "narrowed" or max(sizes) == 128
    assert min(hp.batch_size for hp in drawn) == 100
    assert max(hp.learning_rate for hp in drawn) == 2e-3

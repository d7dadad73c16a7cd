"""The seeds and agents of evaluations."""

from dataclasses import replace
from typing import Annotated

import pytest
from pydantic import Field

from bilevel.agents.training import returns_converged
from bilevel.evaluation import EvaluationRequest
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.nes.confirmation import Confirming
from bilevel.nes.requests import Requests, brief, with_patience
from bilevel.nes.start import ChoosingStart


@pytest.fixture
def requests(small_hp: Hyperparameters) -> Requests:
    return Requests(replace(small_hp, vary_agent="all"), 0)


def require_fresh(requests: list[EvaluationRequest], agents: int) -> None:
    """Require this number of agents, whose seeds and hyperparameters all differ."""
    assert len({request.seed for request in requests}) == agents
    assert len({request.agent for request in requests}) == agents


@hyperparameters
class Long(AgentHyperparameters, agent="long"):
    """An agent whose training and windows cannot be short."""

    max_episodes: Annotated[int, Field(ge=100, le=500)] = 200
    early_out_episodes: Annotated[int, Field(ge=5, le=30)] = 10


def test_short_training_respects_an_agents_ranges(small_hp: Hyperparameters) -> None:
    """In the choice of a start and in patient turns."""
    assert brief(Long()).max_episodes == 100
    for patient, episodes, window in ((60, 100, 30), (150, 150, 30)):
        turn = with_patience(Long(), replace(small_hp.nes, patient_episodes=patient), 1)
        assert (turn.max_episodes, turn.early_out_episodes) == (episodes, window)


def test_patient_agents_do_not_stop_early(small_hp: Hyperparameters) -> None:
    """Even if all returns are equal."""
    agent, patient = small_hp.agents[0], replace(small_hp.nes, patient_episodes=30)
    assert with_patience(agent, patient, turn=1).max_episodes == agent.max_episodes == 13
    longer = with_patience(replace(agent, max_episodes=99), patient, turn=1)
    stop = returns_converged(longer)
    assert longer.max_episodes == 30
    assert not any(stop([1.0] * episodes) for episodes in range(1, 31))
    assert with_patience(agent, small_hp.nes, turn=1) == agent


def test_confirmations_use_fresh_agents(requests: Requests) -> None:
    """In every round, and after a failed confirmation."""
    made: list[EvaluationRequest] = []
    for generation in (4, 9):
        confirming = Confirming(16)
        for _ in range(3):
            new = requests.confirmation(confirming, generation)
            made += new
            confirming = confirming.after([(200.0, 200.0)] * len(new))
        assert len(confirming.returns) == 16
    assert len(made) == 32
    require_fresh(made, 32)


@pytest.mark.parametrize(("episodes", "expected"), [(3, 3), (0, 4), (1, 1)])
def test_tests_of_a_run_have_its_number_of_episodes(
    small_hp: Hyperparameters, episodes: int, expected: int
) -> None:
    """0 selects the agent's number. The first round of the choice of a start has one, and
    confirmations have at least two."""
    nes = replace(small_hp.nes, test_episodes=episodes)
    agents = tuple(replace(agent, test_episodes=4) for agent in small_hp.agents)
    requests = Requests(replace(small_hp, nes=nes, agents=agents), 0)
    choosing = ChoosingStart.between(requests.candidates(0))
    later = replace(choosing, halving=replace(choosing.halving, round=1))
    for made, number in (
        (requests.start(choosing, 0), 1),
        (requests.start(later, 0), expected),
        (requests.confirmation(Confirming(4), 0), max(expected, 2)),
    ):
        assert {request.agent.test_episodes for request in made} == {number}

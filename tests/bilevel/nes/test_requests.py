"""Agents that decide something are fresh: none takes part twice."""

from dataclasses import replace
from typing import Annotated

import pytest
from pydantic import Field

from bilevel.evaluation import EvaluationRequest
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.nes import NES, NESState
from bilevel.nes.confirmation import Confirmation
from bilevel.nes.requests import Requests, as_turn
from bilevel.nes.start import StartRace
from bilevel.tasks import Task


@pytest.fixture
def state(cartpole: Task, small_hp: Hyperparameters) -> NESState:
    return NES(cartpole, small_hp, 0).init()


@pytest.fixture
def asked(small_hp: Hyperparameters) -> Requests:
    return Requests(replace(small_hp, vary_agent="all"), 0)


def require_fresh(requests: list[EvaluationRequest], agents: int) -> None:
    """So many agents, whose random numbers and hyperparameters all differ."""
    assert len({request.seed for request in requests}) == agents
    assert len({request.agent for request in requests}) == agents


@hyperparameters
class Long(AgentHyperparameters, agent="long"):
    """Its training and its windows cannot be short."""

    max_episodes: Annotated[int, Field(ge=100, le=500)] = 200
    early_out_episodes: Annotated[int, Field(ge=5, le=30)] = 10


def test_an_agents_own_ranges_are_kept(small_hp: Hyperparameters) -> None:
    """In the choice of a start, which asks for fewer episodes, and in patient turns."""
    requests = StartRace.of([0]).requests([(0, Long())])
    assert [vars(request.agent)["max_episodes"] for request in requests] == [100]
    for patient, episodes, window in ((60, 100, 30), (150, 150, 30)):
        turn = as_turn(Long(), replace(small_hp.nes, patient_episodes=patient), 1)
        assert (turn.max_episodes, turn.early_out_episodes) == (episodes, window)


def test_no_agent_confirms_twice(asked: Requests, state: NESState) -> None:
    """Neither in two rounds, nor after a confirmation that failed."""
    made: list[EvaluationRequest] = []
    for generation in (4, 9):
        confirmation = Confirmation(16)
        for _ in range(3):
            now = asked.confirmation(replace(state, generation=generation), confirmation)
            made += now
            confirmation = confirmation.after([200.0] * len(now))
        assert len(confirmation.all_scores) == 16
    assert len(made) == 32
    require_fresh(made, 32)


def test_no_agent_chooses_a_start_twice(asked: Requests, state: NESState) -> None:
    """Neither in two rounds, nor in two attempts; the candidates of a round share their agents."""
    made: list[EvaluationRequest] = []
    for attempt in (0, 1):
        race = StartRace.of(range(64))
        for left, agents in ((64, 1), (8, 4), (2, 8)):
            race = replace(race, seeds=race.seeds[:left])
            now = asked.start(replace(state, attempt=attempt), race)
            assert len(now) == left * agents
            made += now
            race = replace(race, round=race.round + 1)
    require_fresh(made, 2 * (1 + 4 + 8))

import pickle
from dataclasses import replace

import pytest

from bilevel import InvalidInput
from bilevel.hyperparameters import (
    AgentHyperparameters,
    DDQNHyperparameters,
    SEHyperparameters,
)
from bilevel.hyperparameters.validation import hyperparameters
from bilevel.recipes import load_recipe
from tests.conftest import restored


def test_a_run_needs_one_or_more_different_agents() -> None:
    hp = load_recipe("paper", "")
    for agents in ((), (*hp.agents, *hp.agents)):
        with pytest.raises(InvalidInput, match="one or more different agents"):
            replace(hp, agents=agents)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"learning_rate": 7.0}, r"^ddqn\.learning_rate: must be less than or equal to 1; got 7.0"),
        ({"learning_rate": float("nan")}, "learning_rate"),
        ({"hidden_layers": True}, "hidden_layers: must be a valid integer; got True"),
        ({"batch_size": 12.0}, r"ddqn\.batch_size: must be a valid integer"),
        ({"discount": "\n"}, r"^ddqn\.discount: must be a valid number; got '\\n'$"),
        ({"activation": "gelu"}, r"ddqn\.activation: must be 'tanh', 'relu', 'lrelu' or 'prelu'"),
    ],
)
def test_out_of_range(
    changes: dict[str, object], message: str, small_agent: DDQNHyperparameters
) -> None:
    with pytest.raises(InvalidInput, match=message):
        replace(small_agent, **changes)  # type: ignore[arg-type]


def test_an_int_is_accepted_as_a_float(small_agent: DDQNHyperparameters) -> None:
    changed = replace(small_agent, discount=1)
    assert isinstance(changed.discount, float)
    assert changed == replace(small_agent, discount=1.0)
    assert hash(changed) == hash(pickle.loads(pickle.dumps(changed)))


def test_unknown_and_missing_fields() -> None:
    with pytest.raises(InvalidInput, match=r"unknown 'se\.width'"):
        SEHyperparameters(width=3)  # type: ignore[call-arg]
    with pytest.raises(InvalidInput, match=r"^'se\.activation' is missing$"):
        SEHyperparameters(family="plain", hidden_layers=1, hidden_size=4, step_limit=0)  # type: ignore[call-arg]
    with pytest.raises(InvalidInput, match=r"^hyperparameters: 'nes' is missing$"):
        restored({})


@pytest.mark.parametrize("name", ["ddqn", "dueling-ddqn"])
@pytest.mark.parametrize("layers", [1, 3])
def test_the_cost_of_a_step_counts_every_hidden_layer(name: str, layers: int) -> None:
    """A dueling network has one more hidden layer than its hyperparameters."""
    (agent,) = load_recipe("default", "CartPole-v0", agents=(name,)).agents
    assert isinstance(agent, DDQNHyperparameters)
    agent = replace(agent, hidden_layers=layers)
    wide = [n_in * n_out for n_in, n_out in agent.network(4, 2).shapes if min(n_in, n_out) > 4]
    counted = agent.batch_size * (sum(wide) + 8 * agent.hidden_size)
    assert agent.step_cost == counted


def test_agents_that_never_learn_are_rejected() -> None:
    """Agents do not learn in their `init_episodes`."""
    hp = load_recipe("exogenous", "CartPole-v0", agents=("ddqn", "td3"))
    ddqn, td3 = hp.agents
    replace(hp, agents=(ddqn, replace(td3, init_episodes=19, max_episodes=20)))
    with pytest.raises(InvalidInput, match=r"td3\.init_episodes must be below td3\.m.*, 20; got"):
        replace(hp, agents=(ddqn, replace(td3, init_episodes=20, max_episodes=20)))
    for patient in (0, ddqn.init_episodes + 1):
        replace(hp, nes=replace(hp.nes, patient_episodes=patient))
    with pytest.raises(InvalidInput, match=r"ddqn\.init_episodes must be .*nes\.patient"):
        replace(hp, nes=replace(hp.nes, patient_episodes=ddqn.init_episodes))


def test_attributes_without_a_type_are_rejected() -> None:
    with pytest.raises(InvalidInput, match=r"Untyped.max_episodes needs a type annotation"):

        @hyperparameters
        class Untyped(AgentHyperparameters):
            max_episodes = 11

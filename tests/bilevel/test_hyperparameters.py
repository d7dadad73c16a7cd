from dataclasses import replace

import pytest

from bilevel import InvalidInput
from bilevel.hyperparameters import (
    PRESETS,
    UPDATES,
    DDQNHyperparameters,
    Hyperparameters,
    SEHyperparameters,
    TD3Hyperparameters,
    best_preset,
    load_preset,
)
from tests.conftest import ddqn

TASKS = ("CartPole-v0", "Acrobot-v1")


@pytest.mark.parametrize("update", UPDATES)
@pytest.mark.parametrize("task_id", TASKS)
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("agents", [("ddqn",), ("dueling-ddqn",), ("td3", "ddqn")])
def test_every_preset_builds_and_survives_a_round_trip(
    preset: str, task_id: str, update: str, agents: tuple[str, ...]
) -> None:
    hp = load_preset(preset, task_id, update, agents)
    assert tuple(agent.agent for agent in hp.agents) == agents
    assert hp.nes.update == update
    assert Hyperparameters.from_dict(hp.to_dict()) == hp


def test_the_papers_numbers() -> None:
    cartpole = load_preset("tuned", "CartPole-v0", "paper")
    acrobot = load_preset("tuned", "Acrobot-v1", "paper")
    default = load_preset("default", "CartPole-v0", "paper")
    assert (cartpole.nes.step_size, cartpole.nes.std_dev) == (0.148, 0.0124)
    assert (acrobot.nes.step_size, acrobot.nes.std_dev) == (0.727, 0.0114)
    assert (default.nes.step_size, default.nes.std_dev) == (1.0, 0.05)
    assert (cartpole.se.hidden_size, cartpole.se.activation) == (83, "lrelu")
    assert (acrobot.se.hidden_size, acrobot.se.activation) == (167, "prelu")
    for hp in (cartpole, acrobot, default):
        assert hp.nes.score_transform == "better-average"
        assert (hp.nes.population_size, hp.nes.generations) == (16, 200)
        assert hp.agents[0].max_episodes == 1000
        assert (hp.agents[0].early_out_episodes, hp.agents[0].early_out_difference) == (10, 0.01)
    assert ddqn(cartpole).batch_size == 199
    assert acrobot.agents[0].init_episodes == 20
    assert ddqn(default).hidden_layers == 2
    td3 = load_preset("tuned", "CartPole-v0", agents=("td3",)).agents[0]
    assert isinstance(td3, TD3Hyperparameters)
    assert (td3.learning_rate, td3.activation, td3.initial_temperature) == (0.0005, "tanh", 1.0)


def test_what_a_run_trains_is_at_least_one_agent_each_once() -> None:
    hp = load_preset("default", "CartPole-v0")
    for agents in ((), (*hp.agents, *hp.agents)):
        with pytest.raises(InvalidInput, match="one or more, each once"):
            replace(hp, agents=agents)


def test_a_dueling_network_needs_a_unit_a_stream() -> None:
    (agent,) = load_preset("default", "CartPole-v0", agents=("dueling-ddqn",)).agents
    assert isinstance(agent, DDQNHyperparameters)
    with pytest.raises(InvalidInput, match="hidden_size must be at least 2"):
        replace(agent, hidden_size=1)


def test_tuned_is_best_where_there_is_one() -> None:
    assert best_preset("CartPole-v0") == best_preset("Acrobot-v1") == "tuned"
    assert best_preset("MountainCar-v0") == best_preset("../x") == "default"


def test_unknown_names() -> None:
    with pytest.raises(InvalidInput, match="unknown preset 'best': allowed are tuned, default"):
        load_preset("best", "CartPole-v0")
    with pytest.raises(InvalidInput, match="unknown update"):
        load_preset("tuned", "CartPole-v0", "sgd")
    with pytest.raises(InvalidInput, match="no preset 'tuned' for the task 'MountainCar-v0'"):
        load_preset("tuned", "MountainCar-v0")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"learning_rate": 7.0}, r"DDQN learning_rate must be float, 1e-08 to 1.0; got 7.0"),
        ({"learning_rate": float("nan")}, "learning_rate"),
        ({"hidden_layers": 4}, "hidden_layers must be int, 1 to 3; got 4"),
        ({"hidden_layers": True}, "hidden_layers"),
        ({"batch_size": 12.0}, "batch_size must be int"),
        ({"activation": "gelu"}, "unknown DDQN activation 'gelu': allowed are tanh, relu"),
    ],
)
def test_out_of_range(
    changes: dict[str, object], message: str, small_agent: DDQNHyperparameters
) -> None:
    with pytest.raises(InvalidInput, match=message):
        replace(small_agent, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("update", ["paired", "antithetic"])
def test_updates_on_pairs_need_mirrored_sampling(update: str) -> None:
    nes = load_preset("tuned", "CartPole-v0", update).nes
    with pytest.raises(InvalidInput, match="needs mirrored_sampling"):
        replace(nes, mirrored_sampling=False)


def test_unknown_and_missing_fields() -> None:
    with pytest.raises(InvalidInput, match="unknown SEHyperparameters field 'width'"):
        SEHyperparameters.from_dict({"width": 3})
    with pytest.raises(InvalidInput, match="activation"):
        SEHyperparameters.from_dict({"hidden_layers": 1, "hidden_size": 4})
    with pytest.raises(InvalidInput, match="lack the section 'nes'"):
        Hyperparameters.from_dict({})


def test_the_paired_update_on_cartpole_is_for_agents_of_the_default_table() -> None:
    tuned, default = (load_preset(name, "CartPole-v0") for name in ("tuned", "default"))
    assert tuned.agents == default.agents
    assert load_preset("tuned", "CartPole-v0", "paper").agents != default.agents

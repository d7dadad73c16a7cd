import json
from dataclasses import fields

import numpy as np
import pytest
from scipy.stats import kstest

from bilevel import InvalidInput
from bilevel.hyperparameters import DDQNHyperparameters, Hyperparameters, load_preset
from search_spaces import SPACES, search_space, to_hyperparameters, vary_agent

SAMPLES = 300

#: The paper's Table 1: low, high, scale.
TABLE_1 = {
    "nes.step_size": (0.1, 1, "log"),
    "nes.std_dev": (0.01, 1, "log"),
    "se.hidden_layers": (1, 2, "linear"),
    "se.hidden_size": (48, 192, "log"),
    "agent.init_episodes": (1, 20, "log"),
    "agent.batch_size": (64, 256, "linear"),
    "agent.learning_rate": (0.0001, 0.005, "log"),
    "agent.target_update_rate": (0.005, 0.05, "log"),
    "agent.discount": (0.9, 0.999, "inverse"),
    "agent.initial_epsilon": (0.8, 1, "log"),
    "agent.minimal_epsilon": (0.005, 0.05, "log"),
    "agent.epsilon_decay": (0.8, 0.99, "inverse"),
    "agent.hidden_layers": (1, 2, "linear"),
    "agent.hidden_size": (48, 192, "log"),
}


def base(space: str) -> Hyperparameters:
    return load_preset("tuned", "CartPole-v0", SPACES[space])


def drawn(space: str) -> list[Hyperparameters]:
    samples = search_space(space, seed=0).sample_configuration(SAMPLES)
    return [to_hyperparameters(base(space), dict(sample)) for sample in samples]


@pytest.mark.parametrize("space", SPACES)
def test_every_sample_builds_valid_hyperparameters_of_plain_types(space: str) -> None:
    for hp in drawn(space):
        assert Hyperparameters.from_dict(json.loads(json.dumps(hp.to_dict()))) == hp


def test_full_is_table_1() -> None:
    assert len(search_space("full")) == 18
    hps = drawn("full")
    for name, (low, high, scale) in TABLE_1.items():
        section, field = name.split(".")
        values = np.array([float(getattr(getattr(hp, section), field)) for hp in hps])
        assert low - 1e-9 <= values.min() <= values.max() <= high + 1e-9
        if isinstance(getattr(getattr(hps[0], section), field), float):
            ends = np.array([low, high], float)
            if scale == "inverse":
                values, ends = 1 - values, 1 - ends[::-1]
            if scale != "linear":
                values, ends = np.log(values), np.log(ends)
            assert kstest((values - ends[0]) / (ends[1] - ends[0]), "uniform").pvalue > 1e-3, name
        else:
            assert {low, high} <= set(values.astype(int)) or high > 2
    assert {hp.nes.mirrored_sampling for hp in hps} == {True, False}
    assert len({hp.nes.score_transform for hp in hps}) == 8
    assert len({hp.se.activation for hp in hps}) == len({hp.agent.activation for hp in hps}) == 4


def test_core_is_small_and_for_the_antithetic_update() -> None:
    assert len(search_space("core")) == 6
    assert all(hp.nes.update == "antithetic" for hp in drawn("core"))


def test_numpy_scalars_are_taken() -> None:
    values = {
        "se.activation": np.str_("tanh"),
        "nes.mirrored_sampling": np.bool_(True),
        "agent.batch_size": np.int64(70),
        "agent.1-discount": np.float64(0.02),
    }
    hp = to_hyperparameters(base("full"), values)
    assert (hp.se.activation, hp.agent.batch_size) == ("tanh", 70)
    assert hp.agent.discount == pytest.approx(0.98)
    assert type(hp.nes.mirrored_sampling) is bool


def test_unknown_names_and_values() -> None:
    with pytest.raises(InvalidInput, match="unknown search space 'huge'"):
        search_space("huge")
    with pytest.raises(InvalidInput, match=r"unknown hyperparameter 'agent\.width'"):
        to_hyperparameters(base("core"), {"agent.width": 1})
    with pytest.raises(InvalidInput, match="batch_size"):
        to_hyperparameters(base("core"), {"agent.batch_size": -1})


class TestAgentVariation:
    def test_ranges_of_the_paper(self) -> None:
        agent = load_preset("default", "CartPole-v0").agent
        agents = [vary_agent(agent, seed) for seed in range(SAMPLES)]
        for name, low, high in (
            ("learning_rate", 1e-3 / 3, 3e-3),
            ("batch_size", 42, 384),
            ("hidden_size", 42, 384),
            ("hidden_layers", 1, 3),
        ):
            values = [getattr(a, name) for a in agents]
            assert low <= min(values) < max(values) <= high
        assert {a.hidden_layers for a in agents} == {1, 2, 3}
        sizes = np.log([a.hidden_size for a in agents])
        uniform = (sizes - np.log(42)) / np.log(384 / 42)
        assert kstest(uniform, "uniform").pvalue > 1e-3

    def test_only_four_are_varied_and_only_by_the_seed(
        self, small_agent: DDQNHyperparameters
    ) -> None:
        one, two = vary_agent(small_agent, 2**63 + 5), vary_agent(small_agent, 2**63 + 5)
        assert one == two
        varied = {"learning_rate", "batch_size", "hidden_size", "hidden_layers"}
        for spec in fields(small_agent):
            if spec.name not in varied:
                assert getattr(one, spec.name) == getattr(small_agent, spec.name)

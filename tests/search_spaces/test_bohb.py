import json

import numpy as np
import pytest
from scipy.stats import kstest

from bilevel import InvalidInput
from bilevel.hyperparameters import (
    Hyperparameters,
    load_recipe,
)
from bilevel.nes import NES
from bilevel.tasks import get_task
from search_spaces import SPACES
from search_spaces.bohb import search_space
from search_spaces.prior import nearest
from search_spaces.translation import of_hyperparameters, to_hyperparameters
from tests.conftest import ddqn, restored

SAMPLES = 300

#: The paper's optimized hyperparameters: low, high, scale.
OPTIMIZED = {
    "nes.step_size": (0.1, 1, "log"),
    "nes.std_dev": (0.01, 1, "log"),
    "se.hidden_layers": (1, 2, "linear"),
    "se.hidden_size": (48, 192, "log"),
    "ddqn.init_episodes": (1, 20, "log"),
    "ddqn.batch_size": (64, 256, "linear"),
    "ddqn.learning_rate": (0.0001, 0.005, "log"),
    "ddqn.target_update_rate": (0.005, 0.05, "log"),
    "ddqn.discount": (0.9, 0.999, "inverse"),
    "ddqn.initial_epsilon": (0.8, 1, "log"),
    "ddqn.minimal_epsilon": (0.005, 0.05, "log"),
    "ddqn.epsilon_decay": (0.8, 0.99, "inverse"),
    "ddqn.hidden_layers": (1, 2, "linear"),
    "ddqn.hidden_size": (48, 192, "log"),
}


def base(space: str) -> Hyperparameters:
    return load_recipe(SPACES[space], "CartPole-v0")


def drawn(space: str) -> list[Hyperparameters]:
    samples = search_space(space, seed=0).sample_configuration(SAMPLES)
    return [to_hyperparameters(base(space), dict(sample)) for sample in samples]


@pytest.mark.parametrize("space", SPACES)
def test_every_sample_builds_valid_hyperparameters_of_plain_types(space: str) -> None:
    for hp in drawn(space):
        assert restored(json.loads(json.dumps(hp.to_dict()))) == hp


def test_full_is_the_papers_table() -> None:
    assert len(search_space("full")) == 18
    hps = drawn("full")
    for name, (low, high, scale) in OPTIMIZED.items():
        section, field = name.split(".")
        parts = [ddqn(hp) if section == "ddqn" else getattr(hp, section) for hp in hps]
        values = np.array([float(getattr(part, field)) for part in parts])
        assert low - 1e-9 <= values.min() <= values.max() <= high + 1e-9
        if isinstance(getattr(parts[0], field), float):
            ends = np.array([low, high], float)
            if scale == "inverse":
                values, ends = 1 - values, 1 - ends[::-1]
            if scale != "linear":
                values, ends = np.log(values), np.log(ends)
            assert kstest((values - ends[0]) / (ends[1] - ends[0]), "uniform").pvalue > 1e-3, name
        else:
            drawn_in = np.log(values) if scale != "linear" else values
            ends = np.log([low, high]) if scale != "linear" else np.array([low, high])
            assert abs(np.mean(drawn_in) - np.mean(ends)) < 0.05 * np.ptp(ends), name
            assert {low, high} <= set(values.astype(int)) or high > 20
    assert {hp.nes.mirrored_sampling for hp in hps} == {True, False}
    assert len({hp.nes.score_transform for hp in hps}) == 8
    assert len({hp.se.activation for hp in hps}) == len({ddqn(hp).activation for hp in hps}) == 4


def test_core_is_small_and_for_the_default_recipe() -> None:
    assert len(search_space("core")) == 8
    hps = drawn("core")
    assert all(hp.nes.update == "snes" for hp in hps)
    assert all(12 <= hp.se.hidden_size <= 64 for hp in hps)


@pytest.mark.parametrize("task", ["CartPole-v0", "Acrobot-v1"])
def test_a_search_in_core_can_find_the_default_recipe(task: str) -> None:
    space = search_space("core")
    recipe = of_hyperparameters(load_recipe("default", task), space)
    assert nearest(space, recipe) == pytest.approx(recipe)


@pytest.mark.parametrize("task", ["CartPole-v0", "Acrobot-v1"])
@pytest.mark.parametrize("space", SPACES)
def test_every_sample_is_a_run(space: str, task: str) -> None:
    """With the space's recipe its SEs can be built, and its update rule fits the sampling."""
    recipe = load_recipe(SPACES[space], task)
    for sample in search_space(space, seed=1).sample_configuration(50):
        NES(get_task(task), to_hyperparameters(recipe, dict(sample)))


def test_an_unknown_space_is_told() -> None:
    with pytest.raises(InvalidInput, match="unknown search space 'huge'"):
        search_space("huge")


class TestOtherAgents:
    def test_the_space_has_the_fields_of_the_agent(self) -> None:
        names = set(search_space("full", ("td3",)))
        assert "td3.policy_delay" in names
        assert "td3.initial_epsilon" not in names
        both = set(search_space("full", ("td3", "dueling-ddqn")))
        assert {"td3.init_episodes", "dueling-ddqn.init_episodes"} <= both

    def test_the_core_space_tunes_no_agents(self) -> None:
        """They are drawn anew all the time, so that an SE teaches all of them."""
        assert search_space("core", ("td3", "dueling-ddqn")) == search_space("core")

    @pytest.mark.parametrize("space", SPACES)
    def test_every_sample_builds_valid_hyperparameters(self, space: str) -> None:
        agents = ("dueling-ddqn", "td3")
        hp = load_recipe(SPACES[space], "CartPole-v0", agents)
        for sample in search_space(space, agents, seed=0).sample_configuration(50):
            built = to_hyperparameters(hp, dict(sample))
            assert restored(built.to_dict()) == built

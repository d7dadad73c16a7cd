import json

import numpy as np
import pytest
from scipy.stats import kstest

from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.recipes import load_recipe
from bilevel.tasks import get_task
from search_spaces import SPACES
from search_spaces.bohb import search_space
from search_spaces.prior import nearest
from search_spaces.translation import of_hyperparameters, to_hyperparameters
from tests.conftest import ddqn, restored

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


def samples(
    space: str, count: int, task: str = "CartPole-v0", agents: tuple[str, ...] = ("ddqn",)
) -> list[Hyperparameters]:
    base = load_recipe(SPACES[space], task, agents)
    drawn = search_space(space, agents, seed=0).sample_configuration(count)
    return [to_hyperparameters(base, dict(sample)) for sample in drawn]


@pytest.mark.parametrize("agents", [("ddqn",), ("dueling-ddqn", "td3")])
@pytest.mark.parametrize("task", ["CartPole-v0", "Acrobot-v1"])
@pytest.mark.parametrize("space", SPACES)
def test_nes_accepts_all_samples(space: str, task: str, agents: tuple[str, ...]) -> None:
    for hp in samples(space, 50, task, agents):
        assert restored(json.loads(json.dumps(hp.to_dict()))) == hp
        NES(get_task(task), hp)


@pytest.fixture(scope="module")
def full() -> list[Hyperparameters]:
    return samples("full", 300)


@pytest.mark.parametrize("name", OPTIMIZED)
def test_distributions_of_the_papers_table(name: str, full: list[Hyperparameters]) -> None:
    low, high, scale = OPTIMIZED[name]
    section, field = name.split(".")
    parts = [ddqn(hp) if section == "ddqn" else getattr(hp, section) for hp in full]
    values, ends = np.array([float(getattr(part, field)) for part in parts]), np.array([low, high])
    assert low - 1e-9 <= values.min() <= values.max() <= high + 1e-9
    if scale == "inverse":
        values, ends = 1 - values, 1 - ends[::-1]
    if scale != "linear":
        values, ends = np.log(values), np.log(ends)
    scaled = (values - ends[0]) / np.ptp(ends)
    if isinstance(getattr(parts[0], field), float):
        assert kstest(scaled, "uniform").pvalue > 1e-3
    else:
        assert abs(scaled.mean() - 0.5) < 0.05


def test_full_has_the_dimensions_of_each_agent() -> None:
    assert len(search_space("full")) == 18
    names = set(search_space("full", ("td3", "dueling-ddqn")))
    assert {"td3.policy_delay", "td3.init_episodes", "dueling-ddqn.init_episodes"} <= names
    assert not {"td3.initial_epsilon", "ddqn.init_episodes"} & names


@pytest.mark.parametrize("task", ["CartPole-v0", "Acrobot-v1"])
def test_core_contains_the_default_recipe(task: str) -> None:
    space = search_space("core")
    recipe = of_hyperparameters(load_recipe("default", task), space)
    assert nearest(space, recipe) == pytest.approx(recipe)

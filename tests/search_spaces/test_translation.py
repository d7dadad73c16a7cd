import subprocess
import sys

import numpy as np
import pytest

from bilevel import InvalidInput
from bilevel.hyperparameters import Hyperparameters, load_recipe
from search_spaces.bohb import search_space
from search_spaces.translation import of_hyperparameters, to_hyperparameters
from tests.conftest import ddqn


@pytest.fixture
def paper() -> Hyperparameters:
    return load_recipe("paper", "CartPole-v0")


def test_numpy_scalars_are_taken(paper: Hyperparameters) -> None:
    values = {
        "se.activation": np.str_("tanh"),
        "nes.mirrored_sampling": np.bool_(True),
        "ddqn.batch_size": np.int64(70),
        "ddqn.1-discount": np.float64(0.02),
    }
    hp = to_hyperparameters(paper, values)
    assert (hp.se.activation, ddqn(hp).batch_size) == ("tanh", 70)
    assert ddqn(hp).discount == pytest.approx(0.98)
    assert type(hp.nes.mirrored_sampling) is bool


def test_unknown_names_and_values(paper: Hyperparameters) -> None:
    with pytest.raises(InvalidInput, match=r"unknown hyperparameter 'ddqn\.width'"):
        to_hyperparameters(paper, {"ddqn.width": 1})
    with pytest.raises(InvalidInput, match=r"^td3\.batch_size is of an agent that takes no"):
        to_hyperparameters(paper, {"td3.batch_size": 8})
    with pytest.raises(InvalidInput, match="batch_size"):
        to_hyperparameters(paper, {"ddqn.batch_size": -1})


@pytest.mark.parametrize("name", ["core", "full"])
def test_values_of_hyperparameters_are_the_inverse(paper: Hyperparameters, name: str) -> None:
    space = search_space(name)
    for configuration in (dict(c) for c in space.sample_configuration(20)):
        values = of_hyperparameters(to_hyperparameters(paper, configuration), space)
        for dimension, value in configuration.items():
            assert values[dimension] == pytest.approx(value)
    with pytest.raises(InvalidInput, match=r"has no hyperparameter 'td3\.policy_delay'"):
        of_hyperparameters(paper, ["td3.policy_delay"])


def test_it_does_not_import_configspace() -> None:
    """The import takes a second, and commands that search nothing begin with a translation too."""
    code = "import sys, search_spaces.translation; sys.exit('ConfigSpace' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

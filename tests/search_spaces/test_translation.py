import subprocess
import sys

import numpy as np
import pytest

from bilevel import InvalidInput
from bilevel.hyperparameters import Hyperparameters
from bilevel.recipes import load_recipe
from search_spaces import SPACES
from search_spaces.bohb import search_space
from search_spaces.translation import of_hyperparameters, to_hyperparameters
from tests.conftest import ddqn


@pytest.fixture
def paper() -> Hyperparameters:
    return load_recipe("paper", "CartPole-v0")


def test_numpy_scalars_are_converted(paper: Hyperparameters) -> None:
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


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"ddqn.width": 1}, r"unknown hyperparameter 'ddqn\.width': allowed are ddqn\."),
        ({"sgd.width": 1}, r"unknown hyperparameter 'sgd\.width': allowed are nes\.\*, se\.\*"),
        ({"td3.batch_size": 8}, r"^td3\.batch_size is of an agent that takes no part"),
        ({"ddqn.batch_size": -1}, "batch_size must be"),
        ({"ddqn.1-batch_size": 1}, "must be a float; got 1"),
        ({"nes.averaging": 0.1, "nes.1-averaging": 0.1}, "nes.averaging is set twice"),
    ],
)
def test_invalid_configurations(
    values: dict[str, object], message: str, paper: Hyperparameters
) -> None:
    with pytest.raises(InvalidInput, match=message):
        to_hyperparameters(paper, values)


@pytest.mark.parametrize("name", SPACES)
def test_values_of_hyperparameters_are_the_inverse(paper: Hyperparameters, name: str) -> None:
    space = search_space(name)
    for configuration in map(dict, space.sample_configuration(20)):
        values = of_hyperparameters(to_hyperparameters(paper, configuration), space)
        assert {name: values[name] for name in configuration} == pytest.approx(configuration)


def test_values_of_unknown_hyperparameters(paper: Hyperparameters) -> None:
    with pytest.raises(InvalidInput, match=r"has no hyperparameter 'td3\.policy_delay'"):
        of_hyperparameters(paper, ["td3.policy_delay"])


def test_configspace_is_not_imported() -> None:
    """Its import takes a second, which trials and other commands do not need."""
    code = "import sys, search_spaces.translation; sys.exit('ConfigSpace' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

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
        ({"td3.batch_size": 8}, r"unknown hyperparameter 'td3\.batch_size'"),
        ({"ddqn.batch_size": -1}, r"ddqn\.batch_size: must be"),
        ({"ddqn.1-batch_size": 1}, "must be a float; got 1"),
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


def test_configspace_is_not_imported() -> None:
    """Its import takes a second, which trials and other commands do not need."""
    code = "import sys, search_spaces.translation; sys.exit('ConfigSpace' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

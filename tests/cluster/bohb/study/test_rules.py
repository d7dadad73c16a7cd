from dataclasses import replace

import ConfigSpace as CS
import pytest

from bilevel.errors import InvalidInput
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import smallest_hidden_size
from bilevel.tasks import get_task
from cluster.bohb.study.rules import searched_space
from search_spaces.space import Space

TASK = get_task("CartPole-v0")
BASE = load_recipe("default", TASK)
CORE, FULL = Space.of("core"), Space.of("full")


def test_hyperparameters_with_an_effect_can_be_set() -> None:
    assert searched_space(CORE, TASK, BASE, [("nes.generations", 9)]) == CORE
    assert searched_space(CORE, TASK, BASE, [("nes.std_dev", 0.2)], "recipe") == CORE
    authors = load_recipe("authors", TASK)
    assert searched_space(FULL, TASK, authors) == FULL


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nes.solved_for", "nes.solved_for cannot be set to 1 in a search"),
        ("nes.std_dev", "setting it to 1 has no effect: leave it out, or use --prior recipe"),
        ("nes.averaging", "nes.averaging is searched in the space 'core'"),  # as one minus it
    ],
)
def test_hyperparameters_without_an_effect_are_refused(name: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        searched_space(CORE, TASK, BASE, [(name, 1)])


def test_the_space_full_needs_plain_ses_and_constant_agents() -> None:
    with pytest.raises(InvalidInput, match="'default' has exogenous SEs and the rule"):
        searched_space(FULL, TASK, BASE)
    varied = replace(load_recipe("authors", TASK), vary_agent="all")
    with pytest.raises(InvalidInput, match=r"for each agent \(--vary-hp all"):
        searched_space(FULL, TASK, varied)


def test_core_without_the_spread_of_plain_ses() -> None:
    adapted = searched_space(CORE, TASK, load_recipe("paper", TASK)).build()
    assert set(CORE.build()) - set(adapted) == {"se.spread"}


@pytest.mark.parametrize("state_size", [20, 80])
def test_core_has_ses_large_enough_for_the_task(state_size: int) -> None:
    wide = replace(TASK, state_size=state_size)
    adapted = searched_space(CORE, wide, load_recipe("default", "")).build()
    size = adapted["se.hidden_size"]
    assert isinstance(size, CS.UniformIntegerHyperparameter)
    assert size.lower == smallest_hidden_size(wide.state_size, wide.n_actions) > 12
    assert size.upper == max(64, 2 * size.lower)
    assert size.log
    others = set(adapted) - {"se.hidden_size"}
    assert all(adapted[name] == CORE.build()[name] for name in others)

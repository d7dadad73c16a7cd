"""What a search may search."""

from dataclasses import replace

import ConfigSpace as CS
import pytest

from bilevel.errors import InvalidInput
from bilevel.hyperparameters import load_recipe
from bilevel.synthetic_env import least_units
from bilevel.tasks import get_task
from cluster.bohb.study.rules import searched_space
from search_spaces.space import Space

TASK = get_task("CartPole-v0")
BASE = load_recipe("default", TASK)


def test_what_has_an_effect_may_be_set() -> None:
    core = Space.of("core")
    assert searched_space(core, TASK, BASE, [("nes.generations", 9)]) == core
    assert searched_space(core, TASK, BASE, [("nes.std_dev", 0.2)], "recipe") == core


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("nes.solved_for", "nes.solved_for cannot be set to 1 in a search"),
        ("nes.std_dev", "setting it to 1 has no effect: leave it out, or begin with it"),
        ("nes.averaging", "nes.averaging is searched in the space 'core'"),  # as one minus it
    ],
)
def test_what_has_none_is_refused(name: str, told: str) -> None:
    with pytest.raises(InvalidInput, match=told):
        searched_space(Space.of("core"), TASK, BASE, [(name, 1)])


def test_what_nes_does_not_read_is_not_searched() -> None:
    plain = load_recipe("paper", TASK)
    core = Space.of("core").build()
    left = searched_space(Space.of("core"), TASK, plain).build()
    assert set(core) - set(left) == {"se.spread"}
    distilled = searched_space(Space.of("core"), TASK, load_recipe("distilled", TASK)).build()
    assert set(core) - set(distilled) == {"se.spread", "nes.start_candidates"}
    for base, dimension, told in (
        (plain, CS.Float("se.spread", (1.0, 1.2)), "only exogenous SEs have a spread"),
        (BASE, CS.Categorical("nes.ties", ("mean", "order")), "the rule snes ranks the scores"),
    ):
        space = CS.ConfigurationSpace(space=[CS.Float("nes.std_dev", (0.1, 0.2)), dimension])
        mine = Space("mine", dict(space.to_serialized_dict()))
        told = f"has {dimension.name}, which has no effect: {told}"
        with pytest.raises(InvalidInput, match=told):
            searched_space(mine, TASK, base)


def test_what_is_read_by_some_configurations_is_searched() -> None:
    space = CS.ConfigurationSpace(
        space=[
            CS.Categorical("nes.update", ("snes", "paper")),
            CS.Categorical("nes.score_transform", ("nes", "better-average")),
        ]
    )
    mine = Space("mine", dict(space.to_serialized_dict()))
    assert searched_space(mine, TASK, BASE) == mine


def test_the_papers_ranges_need_the_papers_ses_and_agents_that_do_not_vary() -> None:
    full, authors = Space.of("full"), load_recipe("authors", TASK)
    assert searched_space(full, TASK, authors) == full
    with pytest.raises(InvalidInput, match="'default' has exogenous SEs and the rule snes"):
        searched_space(full, TASK, BASE)
    with pytest.raises(InvalidInput, match=r"draw it anew for each agent \(--vary-hp all"):
        searched_space(full, TASK, replace(authors, vary_agent="all"))


def test_ses_have_units_enough_for_the_task() -> None:
    wide = replace(TASK, state_size=20)
    raised = searched_space(Space.of("core"), wide, load_recipe("default", "")).build()
    units = raised["se.hidden_size"]
    assert isinstance(units, CS.UniformIntegerHyperparameter)
    assert units.lower == least_units(wide) > 12

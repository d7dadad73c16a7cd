from dataclasses import replace

import ConfigSpace as CS

from bilevel.hyperparameters import load_recipe
from search_spaces.bohb import search_space
from search_spaces.prior import nearest
from search_spaces.translation import of_hyperparameters


def test_values_out_of_the_space_become_the_nearest() -> None:
    space = search_space("core")
    hp = load_recipe("default", "CartPole-v0")
    wide = of_hyperparameters(
        replace(hp, nes=replace(hp.nes, std_dev=9.0), se=replace(hp.se, hidden_size=1000)),
        space,
    )
    found = nearest(space, wide)
    assert (found["nes.std_dev"], found["se.hidden_size"]) == (1.0, 64)
    assert type(found["se.hidden_size"]) is int
    CS.Configuration(space, values=found)  # raises for one that is not in it

"""Families of SEs: what NES searches, and how a random SE is drawn.

A family decodes a *genotype* (D,), the vector that NES moves, into the parameters psi (P,) of
three plain MLPs.

name         genotype
----------   -----------------------------------------------------------------------------
plain        psi itself, initialised uniformly in +-1/sqrt(fan_in) (the paper's)
exogenous    a hand-designed subset: next states ignore the action, rewards compare actions

A new family takes one module with a class that implements `Family`, and one line in `_FAMILIES`.
"""

from collections.abc import Callable

from bilevel.hyperparameters import SEHyperparameters
from bilevel.synthetic_env.architecture import Architecture
from bilevel.synthetic_env.families.exogenous import ExogenousFamily, smallest_hidden_size
from bilevel.synthetic_env.families.family import Family
from bilevel.synthetic_env.families.plain import PlainFamily
from bilevel.tasks import ObservationScale, Task

__all__ = ["Family", "family_of", "smallest_hidden_size"]

_FAMILIES: dict[str, Callable[[Architecture, ObservationScale, SEHyperparameters], Family]] = {
    "plain": PlainFamily.build,
    "exogenous": ExogenousFamily.build,
}


def family_of(task: Task, hp: SEHyperparameters, scale: ObservationScale) -> Family:
    """Return the family `hp.family` for a task whose observations have this scale.

    Raises InvalidInput for networks that cannot hold the family.
    """
    return _FAMILIES[hp.family](Architecture.of(task, hp), scale, hp)

"""Seeds derived from a run's seed, a purpose, and a path of numbers within that purpose."""

from enum import IntEnum
from numbers import Integral
from typing import Any

import numpy as np

from bilevel.errors import InvalidInput, is_number


class Purpose(IntEnum):
    """Use of a derived seed. Seeds depend on these numbers: never renumber."""

    OBSERVATIONS = 0  # random actions that measure the scale of observations
    INITIAL = 1  # parameters of a random SE
    START = 2  # evaluations that choose among random SEs
    PERTURBATION = 3  # eps of a member
    CENTRE = 4  # evaluations of the unperturbed SE
    MEMBER = 5  # evaluations of perturbed SEs
    AGENT = 6  # hyperparameters of an agent
    RETEST = 8  # evaluations that choose the best SE at the end of a run
    FINAL = 9  # evaluations that score the chosen SE
    CONFIRM = 10  # evaluations that decide whether a run has solved the task
    CONFIGURATION = 11  # the NES run of a study's configuration
    PROPOSAL = 12  # a study's next configuration
    EVALUATION = 13  # fresh agents of `bilevel evaluate`
    EXPERIMENT = 14  # fresh agents of `bilevel experiment`
    VALIDATION = 15  # the NES run of a study's finalist
    IMPUTATION = 16  # values of inactive hyperparameters in a study's model


def checked_seed(seed: Any) -> int:
    """Return a seed as an int. Raise InvalidInput unless it is an integer of at least 0."""
    if not is_number(seed, Integral) or seed < 0:
        raise InvalidInput(f"a seed is an integer of at least 0; got {seed!r}")
    return int(seed)


def derive(root: int, purpose: Purpose, *path: int) -> int:
    """Return a 64-bit seed that depends only on the arguments.

    All paths of a purpose must have the same length, and their numbers must be below 2^32:
    SeedSequence does not distinguish a path from the same path followed by zeros.
    """
    words = np.random.SeedSequence([root, int(purpose), *path]).generate_state(1, np.uint64)
    return int(words[0])


def split(seed: int, parts: int) -> list[int]:
    """Split a seed into `parts` independent 64-bit seeds."""
    return [int(word) for word in np.random.SeedSequence(seed).generate_state(parts, np.uint64)]

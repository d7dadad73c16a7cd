"""BOHB's search spaces, in ConfigSpace."""

from search_spaces.bohb import SPACES, of_hyperparameters, search_space, to_hyperparameters
from search_spaces.prior import around, nearest
from search_spaces.space import Space

__all__ = [
    "SPACES",
    "Space",
    "around",
    "nearest",
    "of_hyperparameters",
    "search_space",
    "to_hyperparameters",
]

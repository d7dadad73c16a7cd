"""BOHB's search spaces, in ConfigSpace."""

from search_spaces.bohb import SPACES, search_space, to_hyperparameters

__all__ = ["SPACES", "search_space", "to_hyperparameters"]

"""ConfigSpace spaces, and their translation to hyperparameters and back."""

from search_spaces.agent_variation import agent_variation_space, vary_agent
from search_spaces.bohb import SPACES, search_space, to_hyperparameters

__all__ = [
    "SPACES",
    "agent_variation_space",
    "search_space",
    "to_hyperparameters",
    "vary_agent",
]

"""ConfigSpace spaces, and their translation to hyperparameters and back."""

from search_spaces.agent_variation import agent_variation_space, draw_agent
from search_spaces.bohb import SPACES, search_space, to_hyperparameters

__all__ = [
    "SPACES",
    "agent_variation_space",
    "draw_agent",
    "search_space",
    "to_hyperparameters",
]

"""BOHB's search spaces, in ConfigSpace.

ConfigSpace, whose import takes a second, is imported by whoever builds a space or draws from it; a
trial, and a command that searches nothing, only translate hyperparameters.
"""

#: Spaces by name, each with the recipe that its ranges of step sizes are meant for.
SPACES = {"full": "paper", "core": "default"}

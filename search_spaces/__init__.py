"""BOHB's search spaces, in ConfigSpace.

ConfigSpace, whose import takes a second, is imported by whoever builds a space or draws from it; a
trial, and a command that searches nothing, only translate hyperparameters.
"""

#: Spaces by name, each with the recipe whose update rule its ranges of step sizes are meant for.
#: The paper's were searched with its authors' code, which takes shorter steps than Algorithm 1.
SPACES = {"full": "authors", "core": "default"}

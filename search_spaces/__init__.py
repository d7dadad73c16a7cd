"""BOHB's search spaces, in ConfigSpace.

Names, files and translation are told without ConfigSpace, whose import takes a second.
"""

#: Spaces by name, each with the recipe that its ranges of step sizes are meant for.
SPACES = {"full": "paper", "core": "default"}

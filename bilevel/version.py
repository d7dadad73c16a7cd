"""The version, in one place."""

__version__ = "0.1.0"

#: Format of run folders, and what the numbers in them mean. A version with another format refuses
#: to resume a run, which would otherwise go on as a different one. Raise it with every change of
#: what a checkpoint, a journal or a recipe's field means.
RUN_FORMAT = 4

"""The version of this package and of its run folders."""

__version__ = "0.1.0"

#: Format of run folders. Increase it whenever a field of a checkpoint, a journal or a recipe gets
#: another meaning: versions with another format then refuse to resume the run.
RUN_FORMAT = 1

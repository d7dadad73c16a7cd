"""The definition of a study and its files."""

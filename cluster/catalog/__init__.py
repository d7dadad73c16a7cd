"""Kinds of runs, the list of all runs, and `bilevel sync`."""

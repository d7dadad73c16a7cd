"""The kinds of runs, and lists of them."""

"""The search: which configuration runs next, how far it gets, and which of the best is chosen."""

"""BOHB's search spaces, in ConfigSpace."""

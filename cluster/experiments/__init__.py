"""The paper's experiments, and a report that compares their results (docs/experiments.md)."""

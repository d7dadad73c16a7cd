"""Scores of agents trained on the real tasks (docs/agents.md)."""

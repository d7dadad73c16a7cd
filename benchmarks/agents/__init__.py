"""What agents learn on the real tasks (docs/agents.md)."""

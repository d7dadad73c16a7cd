"""Compiled twins of the agents, the environments and the training loop."""

"""Agents in readable torch: the definitions that the compiled kernels are held to."""

AGENTS = ("ddqn",)

__all__ = ["AGENTS"]

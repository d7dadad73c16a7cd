"""Measurements behind the figures of README and docs, with their committed results."""

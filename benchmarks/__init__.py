"""Measurements behind the tables of README and docs, with their committed results."""

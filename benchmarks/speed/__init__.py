"""Speed of evaluations and of the start of a command (docs/speed.md)."""

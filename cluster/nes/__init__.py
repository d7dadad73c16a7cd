"""An NES run: command, run, view and pictures."""

"""Speed of the compiled inner loop and of the start of a command."""

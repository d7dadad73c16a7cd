"""`bilevel show`: a picture of an SE, for whoever knows the task and not this project."""

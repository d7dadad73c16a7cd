"""`bilevel show`: a picture of an SE next to the real task."""

"""Whether the search finds better recipes than random ones."""

"""What a search finds: BOHB beside random search."""

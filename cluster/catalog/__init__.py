"""The kinds of runs, their listing, and writing them to MLflow again."""

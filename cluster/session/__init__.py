"""Context of a running command: Ray and MLflow, terminal, signals, the run's status."""

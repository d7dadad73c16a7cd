"""Background services: a Ray head and an MLflow server."""

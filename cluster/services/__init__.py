"""What runs beside the runs: a Ray head and an MLflow server."""

"""Execution of the method: Ray actors, NES runs, BOHB search, MLflow tracking, command line."""

import os

# Research machines are often offline, and telemetry must be opt-in.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
# Children of a Ray process must not inherit a GPU setting: no GPU is used.
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
# This package prints its own progress lines instead of Ray Tune's.
os.environ.setdefault("RAY_AIR_NEW_OUTPUT", "0")

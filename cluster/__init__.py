"""Where it runs: Ray actor pool, NES runs, the BOHB search, MLflow, command line."""

import os

# Research machines are often offline, and nobody asked for these calls home.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
# Children of a Ray process must not inherit a GPU setting that no one here uses.
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
# The runs are shown by this package's own progress lines.
os.environ.setdefault("RAY_AIR_NEW_OUTPUT", "0")

"""What the processes of `lives` share: all the command line imports, and nothing begun."""

import mlflow.pyfunc
import ray.tune

import cluster.bohb.command
import cluster.cli
import cluster.evaluate_command
import cluster.nes_command
import cluster.sync

__all__ = ["cluster", "mlflow", "ray"]

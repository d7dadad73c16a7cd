"""Imports of the command line that the processes of `lives` share."""

import mlflow.pyfunc
import ray.tune

import cluster.bohb.command
import cluster.catalog.sync
import cluster.cli
import cluster.evaluate.command
import cluster.nes.command

__all__ = ["cluster", "mlflow", "ray"]

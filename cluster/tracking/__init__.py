"""Everything that goes to MLflow; only the driver writes there."""

from cluster.tracking.tracker import Tracker

__all__ = ["Tracker"]

"""Tracking in MLflow. Only the driver writes to it."""

from cluster.tracking.mirror import Mirror
from cluster.tracking.tracker import Tracker
from cluster.tracking.view import Document, Point, RegisteredSE, RunView, Views

__all__ = ["Document", "Mirror", "Point", "RegisteredSE", "RunView", "Tracker", "Views"]

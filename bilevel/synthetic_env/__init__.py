"""Synthetic environments (SEs): three networks that replace a real task in training."""

from bilevel.synthetic_env.architecture import NETWORKS, SE, Architecture, Psi
from bilevel.synthetic_env.coordinates import Coordinates, coordinates, least_units
from bilevel.synthetic_env.distribution import SEDistribution
from bilevel.synthetic_env.storage import StoredSE, load_se, save_se, se_bytes

__all__ = [
    "NETWORKS",
    "SE",
    "Architecture",
    "Coordinates",
    "Psi",
    "SEDistribution",
    "StoredSE",
    "coordinates",
    "least_units",
    "load_se",
    "save_se",
    "se_bytes",
]

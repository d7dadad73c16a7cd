"""Synthetic environments (SEs): three networks that replace a real task in training."""

from bilevel.synthetic_env.architecture import NETWORKS, SE, Architecture, Psi
from bilevel.synthetic_env.families import Family, SEDistribution, family_of
from bilevel.synthetic_env.storage import StoredSE, load_se, save_se, se_bytes

__all__ = [
    "NETWORKS",
    "SE",
    "Architecture",
    "Family",
    "Psi",
    "SEDistribution",
    "StoredSE",
    "family_of",
    "load_se",
    "save_se",
    "se_bytes",
]

"""Synthetic environments (SEs): three networks that stand in for a real task."""

from bilevel.synthetic_env.architecture import Architecture, kernel_form
from bilevel.synthetic_env.storage import StoredSE, load_se, save_se, se_bytes

__all__ = [
    "Architecture",
    "StoredSE",
    "kernel_form",
    "load_se",
    "save_se",
    "se_bytes",
]

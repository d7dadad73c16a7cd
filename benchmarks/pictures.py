"""Pictures of the docs: written alike from the same results, and known by them."""

import hashlib
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure


def digest(results: Any) -> str:
    """Of the results that a picture shows; it stands in the picture's description, so
    that a picture of older results is noticed."""
    return hashlib.sha256(json.dumps(results, sort_keys=True).encode()).hexdigest()


def save(figure: Figure, path: Path, results_digest: str) -> None:
    """Write an SVG that is the same whenever it is made of the same."""
    with mpl.rc_context({"svg.hashsalt": path.stem}):
        metadata = {"Date": None, "Description": f"results {results_digest}"}
        figure.savefig(path, metadata=metadata)
    print(f"written to {path}")

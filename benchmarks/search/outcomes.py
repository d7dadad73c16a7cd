"""Outcomes of the configurations that a search tried."""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from cluster.bohb.study.journal import Journal, Origin

#: Objective of a result, and the number of its confirmed SEs.
Outcome = tuple[float, int]
#: The outcomes of configurations by their origin.
ByOrigin = dict[str, list[Outcome]]


def outcomes(journal: Journal, at_budget: bool = False) -> dict[str, ByOrigin]:
    """Return outcomes by budget and origin; results of the recipe itself do not count.

    The objective of a failure is infinite. `at_budget` scales objectives as if each result had
    cost its budget, which results exceed by a part of a generation.
    """
    origins = (Origin.RANDOM, Origin.AROUND_RECIPE, Origin.MODEL)
    budgets = sorted({line.budget for line in journal.results})
    found: dict[str, ByOrigin] = {
        str(budget): {origin.value: [] for origin in origins} for budget in budgets
    }
    for line in journal.results:
        origin = journal.proposals[line.id].origin
        if origin is not Origin.RECIPE:
            objective = math.inf if line.loss is None else line.loss
            if at_budget and "core_seconds" in line.info:
                objective *= line.budget / line.info["core_seconds"]
            outcome = objective, line.info.get("confirmed", 0)
            found[str(line.budget)][origin.value].append(outcome)
    return found


def at_smallest(by_budget: Mapping[str, ByOrigin]) -> ByOrigin:
    """Return the outcomes at the smallest budget, which every configuration gets."""
    return by_budget[min(by_budget, key=int)]


def at_largest(by_budget: Mapping[str, ByOrigin]) -> ByOrigin:
    """Return the outcomes at the largest budget, which random search gives to all configurations
    and other methods to the best ones."""
    return by_budget[max(by_budget, key=int)]


def with_an_se(found: Sequence[Outcome]) -> int:
    """Count the configurations that have found an SE."""
    return sum(confirmed > 0 for _, confirmed in found)


def quartiles(values: Sequence[float]) -> str:
    """Format median and quartiles. If values are infinite, each quartile is one of the values."""
    method: Literal["linear", "inverted_cdf"]
    method = "linear" if np.isfinite(values).all() else "inverted_cdf"
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75), method=method)
    return f"{middle:.0f} ({low:.0f} to {high:.0f})"

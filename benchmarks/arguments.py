"""What several benchmarks take on the command line: a task, and lists of seeds, of which `0-4,9` is
0, 1, 2, 3, 4 and 9."""

import argparse
from collections.abc import Sequence
from itertools import pairwise

from bilevel.errors import InvalidInput
from bilevel.tasks import get_task


def known_task(text: str) -> str:
    """The id of a task. Raises ArgumentTypeError for one that is not known."""
    try:
        return get_task(text).id
    except InvalidInput as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def parse_seeds(text: str) -> list[int]:
    """The seeds, in the order given. Raises ArgumentTypeError for text that is no such list."""
    seeds: list[int] = []
    for part in text.split(","):
        first, *more = part.split("-")
        last = more[-1] if more else first
        ordered = first.isdigit() and last.isdigit() and int(first) <= int(last)
        if len(more) > 1 or not ordered:
            raise argparse.ArgumentTypeError(f"seeds are a list such as 0-4,9; got {text!r}")
        seeds += range(int(first), int(last) + 1)
    return seeds


def format_seeds(seeds: Sequence[int]) -> str:
    """The list as `parse_seeds` reads it, runs of seeds as ranges."""
    starts = [0, *(i for i, (a, b) in enumerate(pairwise(seeds), 1) if b != a + 1), len(seeds)]
    runs = [(seeds[a], seeds[b - 1]) for a, b in pairwise(starts) if a < b]
    return ",".join(f"{a}-{b}" if b > a else str(a) for a, b in runs)

import argparse

import pytest

from benchmarks.arguments import format_seeds, known_task, parse_seeds


@pytest.mark.parametrize(
    ("text", "seeds"),
    [
        ("3", [3]),
        ("0-4,9", [0, 1, 2, 3, 4, 9]),
        ("7,6", [7, 6]),
        ("240-241,300-301", [240, 241, 300, 301]),
    ],
)
def test_lists_of_seeds_are_read_and_written(text: str, seeds: list[int]) -> None:
    assert parse_seeds(text) == seeds
    assert format_seeds(seeds) == text


@pytest.mark.parametrize("text", ["", "a", "1-", "-1", "1,,2", "4-0"])
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="a list such as"):
        parse_seeds(text)


def test_an_unknown_task_is_refused() -> None:
    assert known_task("CartPole-v0") == "CartPole-v0"
    with pytest.raises(argparse.ArgumentTypeError, match="unknown task 'CartPole-v9': allowed are"):
        known_task("CartPole-v9")

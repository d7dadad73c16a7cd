from dataclasses import replace
from typing import get_type_hints

from bilevel.nes import GenerationRecord
from cluster.nes.command import generation_line, of_short_episodes


def test_a_generation_fits_80_columns() -> None:
    zero = {name: kind(0) for name, kind in get_type_hints(GenerationRecord).items()}
    record = GenerationRecord(**zero)
    large = replace(
        record,
        generation=119,
        score_mean=-500.0,
        score_std=112.3,
        train_steps_mean=12345.0,
        generation_seconds=100.0,
    )
    assert len(generation_line(large, -500.0)) <= 80


def test_episodes_that_end_at_once_are_told() -> None:
    zero = {name: kind(0) for name, kind in get_type_hints(GenerationRecord).items()}
    record = replace(GenerationRecord(**zero), train_steps_mean=50.0, train_episodes_mean=40.0)
    told = of_short_episodes(record)
    assert told is not None
    assert told.startswith("episodes on the SE last 1.2 steps on average: agents see little but")
    assert of_short_episodes(replace(record, generation=1)) is None
    assert of_short_episodes(replace(record, train_episodes_mean=10.0)) is None
    assert of_short_episodes(replace(record, train_episodes_mean=0.0)) is None  # all diverged

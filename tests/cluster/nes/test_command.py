"""Output of `bilevel nes`."""

from typing import get_type_hints

from bilevel.nes import GenerationRecord
from cluster.nes.command import generation_line


def test_a_generation_fits_80_columns() -> None:
    zero = {name: kind(0) for name, kind in get_type_hints(GenerationRecord).items()}
    large = {"generation": 119, "score_mean": -500.0, "score_std": 112.3, "generation_seconds": 100}
    record = GenerationRecord(**zero | large | {"train_steps_mean": 12345.0})
    assert len(generation_line(record, -500.0)) <= 80

from dataclasses import replace
from typing import get_type_hints

import pytest

from bilevel.nes import GenerationRecord
from cluster.nes.command import generation_line, short_episode_warning


@pytest.fixture
def record() -> GenerationRecord:
    zero = {name: kind(0) for name, kind in get_type_hints(GenerationRecord).items()}
    return replace(GenerationRecord(**zero), train_steps_mean=50.0, train_episodes_mean=40.0)


def test_a_generation_fits_80_columns(record: GenerationRecord) -> None:
    large = replace(
        record,
        generation=119,
        score_mean=-500.0,
        score_std=112.3,
        train_steps_mean=12345.0,
        generation_seconds=100.0,
    )
    assert len(generation_line(large, -500.0)) <= 80


def test_short_episodes_are_reported_once(record: GenerationRecord) -> None:
    assert "1.2 steps" in (short_episode_warning(record) or "")
    assert short_episode_warning(replace(record, generation=1)) is None
    assert short_episode_warning(replace(record, train_episodes_mean=10.0)) is None
    all_diverged = replace(record, train_episodes_mean=0.0)
    assert short_episode_warning(all_diverged) is None

from pathlib import Path
from typing import Any

import pytest

from benchmarks import machine
from benchmarks.machine import NotMeasured, write_result
from benchmarks.nes.tables import scale_rows, seeds, taught


def run(seed: int, **changes: Any) -> dict[str, Any]:
    """A run as `benchmarks.nes.seeds` writes it."""
    values = {
        "seed": seed,
        "seconds_to_se": 20.0 + seed,
        "seconds": 30.0 + seed,
        "core_seconds": 40.0 + seed,
        "generations": 10 + seed,
        "final_train_steps": 500,
        "solved": True,
        "confirmed": True,
        "real_env_steps": 1_000_000,
        "core_utilisation": 0.9,
    }
    return {**values, **changes}


@pytest.fixture(autouse=True)
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path)


def write(runs: list[dict[str, Any]], asked: str = "0-2") -> None:
    write_result(
        "nes_seeds_CartPole-v0", f"it CartPole-v0 --seeds {asked} --taught 1", {"runs": runs}
    )


def test_failures_are_counted() -> None:
    """Nor is the end of a run without an SE the time until it has one."""
    write([run(0), run(1, solved=False), run(2, confirmed=False)])
    row = seeds().splitlines()[2]
    assert row.startswith("| CartPole-v0 | 2 of 3 (9% to 99%) | 2 of 3 | 20 (20 to 21) |")
    assert "| 31 (30 to 32) | 41 (40 to 42) |" in row
    assert row.endswith("| 11 (10 to 12) | 500 (500 to 500) | 1.0 (1.0 to 1.0) | 90% |")


def test_a_measurement_that_lacks_seeds_counts_as_none() -> None:
    write([run(0), run(1)])
    with pytest.raises(NotMeasured, match="some seeds"):
        seeds()


def test_what_ses_teach_is_told_se_by_se() -> None:
    lessons = [
        {
            "ddqn": {"scores": scores, "train_steps": [100, 300]},
            "sb3 DQN, 2,500 steps": {"scores": scores},
        }
        for scores in ([200.0, 196.0], [190.0, 192.0])
    ]
    write([run(0, taught=lessons[0]), run(1, taught=lessons[1]), run(2)])
    ours, theirs = taught().splitlines()[2:4]
    told = "| 2 | 2 | 194.5 (191.0 to 198.0) |"
    assert ours == f"| CartPole-v0 | ddqn {told} 1 (target 195) | 200 |"
    assert theirs == f"| CartPole-v0 | sb3 DQN, 2,500 steps {told} 2 (target 190) | - |"


def test_steps_that_measure_the_scale_are_compared_seed_by_seed() -> None:
    runs = [
        {
            "steps": steps,
            "seed": seed,
            "mean": [0.01 * (seed % 3), 2 * error * (seed - first)],
            "deviation": [2.0, 2.0],
            "core_seconds": cost * (seed + 1.0),
            "confirmed": (steps, seed) != (1000, 5),
            "solved": seed < solved,
        }
        for steps, error, first, cost, solved in (
            (1000, 0.1, -1, 40, 5),
            (10_000, 0.01, 2.5, 20, 6),
        )
        for seed in range(6)
    ]
    runs.append({**runs[0], "seed": 6, "core_seconds": 9000.0})  # the others have not run it
    fewer, more = scale_rows("CartPole-v0", runs)
    assert fewer[1:6] == ["1 000", "5 of 6", "168", "140 (40 to 240)", ""]
    errors, agreement = fewer[6:]
    assert errors == "0.35, 0.60"
    assert agreement.endswith(", 1.00")
    assert more[1:6] == ["10 000", "6 of 6", "70", "70 (20 to 120)", "0.031"]
    assert scale_rows("CartPole-v0", runs[:9]) == []  # three seeds have run with both

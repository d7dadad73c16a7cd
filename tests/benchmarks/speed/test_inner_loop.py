import pytest

from benchmarks.speed import inner_loop
from benchmarks.speed.bound import Core
from bilevel.threads import one_blas_thread


def test_the_labels_are_those_of_their_cases() -> None:
    cases = inner_loop.cases()  # checks every one
    assert len(cases) == 8


@pytest.mark.parametrize(
    ("label", "other"),
    [
        ("CartPole, DDQN, optimized", "Acrobot, DDQN, optimized"),
        ("CartPole, DDQN, optimized", "CartPole, DDQN, default (2 x 128)"),
        ("CartPole, DDQN, 1 x 42, batch 42", "CartPole, DDQN, 1 x 384"),
        ("CartPole, TD3, default", "CartPole, Dueling DDQN, default"),
    ],
)
def test_a_label_of_another_case_is_noticed(label: str, other: str) -> None:
    with pytest.raises(AssertionError, match="CartPole"):
        inner_loop._assert_labelled(label, inner_loop.cases()[other])


@pytest.mark.parametrize("label", ["CartPole, DDQN, 1 x 42, batch 42", "CartPole, TD3, default"])
def test_a_row_is_of_one_measurement(label: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inner_loop, "SECONDS", 0.002)
    monkeypatch.setattr(inner_loop, "REPEATS", 1)
    with one_blas_thread():
        row = inner_loop.measure(Core(1e12, 1e12), inner_loop.cases()[label])
    kernel, torch = row["kernel_us"]["median"], row["torch_us"]["median"]
    assert row["ratio"]["median"] == pytest.approx(torch / kernel, rel=0.01, abs=0.01)
    assert row["over_bound"]["median"] == pytest.approx(kernel / row["bound_us"], rel=0.05)

"""Joining a Ray cluster that is not there."""

import pytest

from bilevel import InvalidInput
from cluster.ray.connection import ray_cluster


@pytest.mark.parametrize("address", ["127.0.0.1:1", "auto"])
def test_a_cluster_that_does_not_answer_is_told_at_once(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also one that was killed, which Ray still takes for the newest of this machine."""
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")  # else any cluster of this machine is `auto`
    with pytest.raises(InvalidInput, match=rf"no Ray cluster at '{address}'.*refused"):  # noqa: SIM117
        with ray_cluster(address):
            pass

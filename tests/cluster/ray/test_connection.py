"""Invalid addresses of Ray clusters. (Valid ones are tested in tests/system.)"""

import pytest
import ray.autoscaler.sdk

from bilevel import InvalidInput
from cluster.ray.connection import Capacity, ray_cluster, scaled_to


@pytest.mark.parametrize("address", ["127.0.0.1:1", "auto"])
def test_unreachable_cluster_is_reported_at_once(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")
    with pytest.raises(InvalidInput, match=r"no Ray cluster at .*refused"), ray_cluster(address):
        pass


def test_runs_share_cores_equally() -> None:
    capacity = Capacity(cores=12, runs=3)
    assert [capacity.fair_share(workers) for workers in (1, 2, 3, 8)] == [4, 2, 1, 1]
    capacity.require(4, 3)
    with pytest.raises(InvalidInput, match="5 workers each need 15 cores: the cluster has 12"):
        capacity.require(5, 3)


def test_only_joined_clusters_are_scaled(monkeypatch: pytest.MonkeyPatch) -> None:
    requests: list[int] = []
    monkeypatch.setattr(
        ray.autoscaler.sdk, "request_resources", lambda num_cpus: requests.append(num_cpus)
    )
    with scaled_to(3, None):
        assert requests == []
    with scaled_to(3, "127.0.0.1:6379"):
        assert requests == [3]
    assert requests == [3, 0]

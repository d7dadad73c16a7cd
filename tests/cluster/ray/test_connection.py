"""Invalid addresses of Ray clusters. (Valid ones are tested in tests/system.)"""

import pytest

from bilevel import InvalidInput
from cluster.ray.connection import ray_cluster, require_cores


@pytest.mark.parametrize("address", ["127.0.0.1:1", "auto"])
def test_unreachable_cluster_is_reported_at_once(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")
    with pytest.raises(InvalidInput, match=r"no Ray cluster at .*refused"), ray_cluster(address):
        pass


def test_trials_that_fit() -> None:
    require_cores(12, 4, 3)
    with pytest.raises(InvalidInput, match="3 x 5 workers need 15 cores: the cluster has 12"):
        require_cores(12, 5, 3)

"""A study's request for cores reaches Ray's own autoscaler, here with nodes on this machine."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import ray
import yaml

from cluster.ray.connection import Capacity, ray_cluster, scaled_to

pytestmark = pytest.mark.timeout(200)

WORKER = {"resources": {"CPU": 1}, "node_config": {}, "min_workers": 0, "max_workers": 3}


@pytest.fixture
def autoscaling(tmp_path: Path) -> Iterator[str]:
    """Address of a cluster of one core, whose autoscaler may add three nodes of one core each."""
    example = Path(ray.__file__).parent / "autoscaler/_private/fake_multi_node/example.yaml"
    config = yaml.safe_load(example.read_text())
    head = {"resources": {"CPU": 1}, "node_config": {}, "max_workers": 0}
    config["available_node_types"] = {"ray.head.default": head, "small": WORKER}
    config["max_workers"] = 3
    config["idle_timeout_minutes"] = 0.1
    file = tmp_path / "autoscaling.yaml"
    file.write_text(json.dumps(config))
    start = [
        *(str(Path(sys.executable).with_name("ray")), "start", "--head", "--num-cpus=1"),
        *("--port=0", "--include-dashboard=false", f"--autoscaling-config={file}", "--block"),
    ]
    environment = {**os.environ, "AUTOSCALER_UPDATE_INTERVAL_S": "1", "RAY_FAKE_CLUSTER": "1"}
    log = tmp_path / "log"
    with log.open("w") as out:
        process = subprocess.Popen(start, env=environment, stdout=out, stderr=out)
    try:
        yield _address(log, process)
    finally:
        process.terminate()
        process.wait(60)


def _address(log: Path, process: "subprocess.Popen[bytes]") -> str:
    deadline = time.monotonic() + 90
    while time.monotonic() < deadline and process.poll() is None:
        for word in log.read_text().split():
            if word.startswith("--address="):
                return word.removeprefix("--address=").strip("'\"")
        time.sleep(0.2)
    raise AssertionError(log.read_text())


def test_it_adds_the_cores_that_a_study_asks_for(autoscaling: str) -> None:
    with ray_cluster(autoscaling):
        assert Capacity.of_cluster().cores == 1
        with scaled_to(3):
            _until(lambda: Capacity.of_cluster().cores >= 3)


def _until(reached: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120
    while not reached():
        assert time.monotonic() < deadline, ray.nodes()
        time.sleep(0.5)

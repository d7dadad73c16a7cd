"""A study's request for cores reaches Ray's own autoscaler, here with nodes on this machine."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
import ray
from ray.util import get_node_ip_address

from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.tasks import Task
from cluster.ray.connection import Capacity, ray_cluster, scaled_to
from cluster.ray.pool import EvaluationPool
from cluster.services.ports import free_port
from tests.ends import kill_family

pytestmark = pytest.mark.timeout(200)

COMMANDS = (
    "initialization_commands",
    "setup_commands",
    "head_setup_commands",
    "worker_setup_commands",
    "head_start_ray_commands",
    "worker_start_ray_commands",
)
WORKER = {"resources": {"CPU": 1}, "node_config": {}, "min_workers": 0, "max_workers": 3}


@pytest.fixture
def autoscaling(tmp_path: Path) -> Iterator[str]:
    """Address of a cluster without cores, whose autoscaler may add three nodes of one core each."""
    port = free_port()
    address = f"{get_node_ip_address()}:{port}"
    head = {"resources": {"CPU": 0}, "node_config": {}, "max_workers": 0}
    config = {
        "cluster_name": "autoscaling",
        "max_workers": 3,
        "upscaling_speed": 1.0,
        "idle_timeout_minutes": 0.1,
        "provider": {
            "type": "fake_multinode",
            "gcs_address": address,
            "use_node_id_as_ip": True,
            "disable_node_updaters": True,
            "disable_launch_config_check": True,
        },
        "available_node_types": {"ray.head.default": head, "small": WORKER},
        "head_node_type": "ray.head.default",
        **{name: {} for name in ("docker", "auth", "file_mounts", "cluster_synced_files")},
        **{name: [] for name in COMMANDS},
    }
    file = tmp_path / "autoscaling.yaml"
    file.write_text(json.dumps(config))
    command = [
        *(str(Path(sys.executable).with_name("ray")), "start", "--head", "--num-cpus=0", "--block"),
        *(f"--port={port}", "--include-dashboard=false"),
        f"--ray-client-server-port={free_port()}",
        f"--dashboard-agent-listen-port={free_port()}",
        f"--autoscaling-config={file}",
    ]
    # Without tokens, which this process, having imported Ray before, would not send.
    ray = {
        "AUTOSCALER_UPDATE_INTERVAL_S": "1",
        "RAY_FAKE_CLUSTER": "1",
        "RAY_AUTH_MODE": "disabled",
    }
    environment = {**os.environ, **ray}
    log = tmp_path / "log"
    with log.open("w") as out:
        process = psutil.Popen(command, env=environment, stdout=out, stderr=out)
    try:
        _until(lambda: "Ray runtime started" in log.read_text())
        yield address
    finally:
        kill_family(process)


def test_it_adds_the_cores_that_are_asked_for(
    autoscaling: str, cartpole: Task, small_hp: Hyperparameters
) -> None:
    """By a study, or by actors that wait for one."""
    nes = NES(cartpole, small_hp, 0)
    state = nes.init()
    with ray_cluster(autoscaling):
        assert Capacity.of_cluster().cores == 0
        with EvaluationPool.on_cluster(None) as pool:
            requests = nes.ask(state)
            assert len(pool.run(cartpole, state.se, requests)) == len(requests)
        with scaled_to(3, autoscaling):
            _until(lambda: Capacity.of_cluster().cores >= 3)


def test_a_cluster_of_ones_own_has_none() -> None:
    with scaled_to(3, None):
        assert not ray.is_initialized()  # as it would be, had a task been run
    assert not ray.is_initialized()


def _until(reached: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 80
    while not reached():
        assert time.monotonic() < deadline
        time.sleep(0.5)

"""The deployment files agree with the code and the documentation."""

from pathlib import Path
from typing import Any

import yaml
from ray.autoscaler._private.util import prepare_config, validate_config

DEPLOY = Path(__file__).parents[3] / "cluster" / "deploy"


def objects() -> list[dict[str, Any]]:
    return list(yaml.safe_load_all((DEPLOY / "kuberay.yaml").read_text()))


def test_ray_accepts_its_own_file() -> None:
    config = yaml.safe_load((DEPLOY / "ray-up.yaml").read_text())
    validate_config(prepare_config(config))
    config["provider"]["worker_ips"].append("WORKER_ADDRESS_3")
    (nodes,) = prepare_config(config)["available_node_types"].values()
    assert (nodes["min_workers"], nodes["max_workers"]) == (3, 3)


def test_kubernetes_objects_refer_to_each_other() -> None:
    by_kind = {(item["kind"], item["metadata"]["name"]): item for item in objects()}
    cluster = by_kind["RayCluster", "bilevel"]["spec"]
    templates = [cluster["headGroupSpec"]["template"]]
    templates += [group["template"] for group in cluster["workerGroupSpecs"]]
    templates.append(by_kind["Deployment", "mlflow"]["spec"]["template"])
    for template in templates:
        (volume,) = template["spec"]["volumes"]
        claim = volume["persistentVolumeClaim"]["claimName"]
        assert ("PersistentVolumeClaim", claim) in by_kind
        (container,) = template["spec"]["containers"]
        assert container["volumeMounts"] == [{"name": volume["name"], "mountPath": "/shared"}]
    for name in ("mlflow", "mlflow-database"):
        selector = by_kind["Service", name]["spec"]["selector"]
        owner = by_kind.get(("Deployment", name)) or by_kind["StatefulSet", name]
        assert owner["spec"]["template"]["metadata"]["labels"] == selector


def test_versions_are_those_that_are_pinned() -> None:
    pinned = (DEPLOY.parents[1] / "constraints.txt").read_text().splitlines()
    (cluster,) = (item for item in objects() if item["kind"] == "RayCluster")
    assert f"ray=={cluster['spec']['rayVersion']}" in pinned

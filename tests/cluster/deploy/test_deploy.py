"""The deployment files agree with each other and with the pinned versions."""

from pathlib import Path
from typing import Any

import yaml

DEPLOY = Path(__file__).parents[3] / "cluster" / "deploy"


def kubernetes_objects() -> dict[tuple[str, str], Any]:
    objects = yaml.safe_load_all((DEPLOY / "kuberay.yaml").read_text())
    return {(item["kind"], item["metadata"]["name"]): item for item in objects}


def test_kubernetes_objects_refer_to_each_other() -> None:
    objects = kubernetes_objects()
    cluster = objects["RayCluster", "bilevel"]["spec"]
    workers = [group["template"] for group in cluster["workerGroupSpecs"]]
    mlflow = objects["Deployment", "mlflow"]["spec"]["template"]
    for template in (cluster["headGroupSpec"]["template"], *workers, mlflow):
        (volume,) = template["spec"]["volumes"]
        claim = volume["persistentVolumeClaim"]["claimName"]
        assert ("PersistentVolumeClaim", claim) in objects
        (container,) = template["spec"]["containers"]
        assert container["volumeMounts"] == [{"name": volume["name"], "mountPath": "/shared"}]
    for name in ("mlflow", "mlflow-database"):
        selector = objects["Service", name]["spec"]["selector"]
        owner = objects.get(("Deployment", name)) or objects["StatefulSet", name]
        assert owner["spec"]["template"]["metadata"]["labels"] == selector


def test_ray_version_is_the_pinned_version() -> None:
    pinned = (DEPLOY.parents[1] / "constraints.txt").read_text().splitlines()
    version = kubernetes_objects()["RayCluster", "bilevel"]["spec"]["rayVersion"]
    assert f"ray=={version}" in pinned

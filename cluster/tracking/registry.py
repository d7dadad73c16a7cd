"""MLflow's model registry: the best SE of each task has the alias `best`, the newest one `newest`.

The best SE is the one with the highest mean score of fresh agents; of equal ones, the one whose
agents needed fewer training steps; then the newest.
"""

import re
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bilevel.synthetic_env import StoredSE, load_se
from cluster.storage.run_folder import BEST_FILE
from cluster.tracking.view import RegisteredSE

#: Tags of a model version: checksum of its SE file, and time when the SE was saved.
_VERSION, _TIME = "bilevel.sha256", "bilevel.time"


def model_address(task_id: str, alias: str) -> str:
    """URI of a task's SE with that alias. `mlflow.pyfunc.load_model` of it returns an object whose
    `predict` runs the SE."""
    return f"models:/{_model_name(task_id)}@{alias}"


def register_se(client: Any, run_id: str, se: RegisteredSE) -> None:
    """Register an SE once as a version of the task's model, and move the aliases if it ranks
    higher. Raises InvalidInput for a damaged file, and MLflow's exceptions."""
    from mlflow.exceptions import MlflowException

    name, folder = _model_name(se.task_id), f"model-{se.version[:12]}"
    _upload(client, run_id, se, folder)
    tags = {**se.tags, _VERSION: se.version, _TIME: repr(se.time)}
    try:
        description = f"Synthetic environments for {se.task_id}."
        client.create_registered_model(name, description=description)
    except MlflowException as error:
        if error.error_code != "RESOURCE_ALREADY_EXISTS":
            raise
    versions = [
        version
        for version in client.search_model_versions(f"run_id = '{run_id}'")
        if version.name == name and version.tags.get(_VERSION) == se.version
    ]
    if not versions:
        source = f"{client.get_run(run_id).info.artifact_uri}/{folder}"
        versions = [client.create_model_version(name, source, run_id, tags=tags)]
    holders = client.get_registered_model(name).aliases
    for alias, rank in (("best", _quality), ("newest", _age)):
        holder = holders.get(alias)
        if holder is None or rank(client.get_model_version(name, holder).tags) < rank(tags):
            client.set_registered_model_alias(name, alias, versions[0].version)


def _upload(client: Any, run_id: str, se: RegisteredSE, folder: str) -> None:
    """Upload an SE as an MLflow model."""
    import mlflow.pyfunc

    with tempfile.TemporaryDirectory() as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model, file = Path(temporary) / "model", Path(temporary) / BEST_FILE
        file.write_bytes(se.content)
        mlflow.pyfunc.save_model(
            model,
            loader_module="cluster.tracking.se_model",
            data_path=str(file),
            signature=_signature(load_se(file)),
            pip_requirements=[],  # loading needs this package anyway
        )
        client.log_artifacts(run_id, str(model), folder)


def _signature(se: StoredSE) -> Any:
    """Columns of the model's input and output, which MLflow shows and checks."""
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, DataType, Schema

    states = [f"state_{i}" for i in range(se.se.architecture.state_size)]
    inputs = [ColSpec(DataType.double, name) for name in states]
    outputs = [ColSpec(DataType.float, f"next_{name}") for name in states]
    outputs += [ColSpec(DataType.float, name) for name in ("reward", "done")]
    return ModelSignature(Schema([*inputs, ColSpec(DataType.long, "action")]), Schema(outputs))


def _age(tags: Mapping[str, str]) -> tuple[float, ...]:
    return (float(tags.get(_TIME, "-inf")),)


def _quality(tags: Mapping[str, str]) -> tuple[float, ...]:
    score = float(tags.get("final_score_mean", "-inf"))
    steps = float(tags.get("final_train_steps_mean", "inf"))
    return score, -steps, *_age(tags)


def _model_name(task_id: str) -> str:
    return "SE-" + re.sub("[/:]", "_", task_id)  # MLflow's names exclude these characters

"""MLflow's model registry: the best SE of each task, under the alias `best`, and the newest, under
`newest`.

The best SE is the one with the highest mean score of the fresh agents at the end of its run; of
equal ones, the one whose agents needed fewer train steps; then the newest. SEs of a built-in task
with another step limit or solved reward come after all others: their scores mean something else.
"""

import re
import tempfile
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bilevel.synthetic_env import StoredSE, load_se
from bilevel.tasks import BUILT_IN_TASKS
from cluster.storage.run_folder import BEST_FILE
from cluster.tracking.view import RegisteredSE

#: Tags of a model version: checksum of its SE file, and the time when the SE was saved.
_VERSION, _TIME = "bilevel.sha256", "bilevel.time"
#: Tag of an SE of a built-in task with other values.
_VARIANT = "bilevel.task_variant"


def model_address(task_id: str, alias: str) -> str:
    """URI of a task's SE with that alias; `mlflow.pyfunc.load_model` of it returns an object whose
    `predict` runs the SE."""
    return f"models:/{_model_name(task_id)}@{alias}"


def _age(tags: Mapping[str, str]) -> tuple[float, ...]:
    return (float(tags.get(_TIME, "-inf")),)


def _quality(tags: Mapping[str, str]) -> tuple[float, ...]:
    score = float(tags.get("final_score_mean", "-inf"))
    return (
        _VARIANT not in tags,
        score,
        -float(tags.get("final_train_steps_mean", "inf")),
        *_age(tags),
    )


#: What MLflow's stores answer for an alias that no version has.
_NONE_YET = ("INVALID_PARAMETER_VALUE", "RESOURCE_DOES_NOT_EXIST")

#: By alias, the tags of the version that has it are the highest in this order.
_ALIASES: dict[str, Callable[[Mapping[str, str]], tuple[float, ...]]] = {
    "best": _quality,
    "newest": _age,
}


def register_se(client: Any, run_id: str, se: RegisteredSE) -> None:
    """Register an SE file once as a version of the task's model.

    The aliases are set in whatever order SEs are registered.
    """
    import mlflow.pyfunc
    from mlflow.exceptions import MlflowException

    name, folder_name = _model_name(se.task_id), f"model-{se.version[:12]}"
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model, file = Path(folder) / "model", Path(folder) / BEST_FILE
        file.write_bytes(se.content)
        stored = load_se(file)
        mlflow.pyfunc.save_model(
            model,
            loader_module="cluster.tracking.se_model",
            data_path=str(file),
            signature=_signature(stored),
            pip_requirements=[],  # loading needs this package anyway
        )
        client.log_artifacts(run_id, str(model), folder_name)
    tags = {**se.tags, _VERSION: se.version, _TIME: repr(se.time), **_variant(stored)}
    try:
        client.create_registered_model(
            name, description=f"Synthetic environments for {se.task_id}."
        )
    except MlflowException as error:
        if error.error_code != "RESOURCE_ALREADY_EXISTS":
            raise
    versions = [
        version
        for version in client.search_model_versions(f"run_id = '{run_id}'")
        if version.name == name and version.tags.get(_VERSION) == se.version
    ]
    if not versions:
        source = f"{client.get_run(run_id).info.artifact_uri}/{folder_name}"
        versions = [client.create_model_version(name, source, run_id, tags=tags)]
    for alias, order in _ALIASES.items():
        try:
            holder = client.get_model_version_by_alias(name, alias)
        except MlflowException as error:
            if error.error_code not in _NONE_YET:
                raise
            holder = None
        if holder is None or order(holder.tags) < order(tags):
            client.set_registered_model_alias(name, alias, versions[0].version)


def _variant(se: StoredSE) -> dict[str, str]:
    """The tag of an SE of a built-in task with other values than the task's own."""
    usual, limit, solved = BUILT_IN_TASKS.get(se.task_id), se.step_limit, se.solved_reward
    if usual is None or (usual.step_limit, usual.solved_reward) == (limit, solved):
        return {}
    return {_VARIANT: f"{limit} steps, solved at {solved:g}"}


def _signature(se: StoredSE) -> Any:
    """The columns of a model's input and output, which MLflow shows and checks."""
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, DataType, Schema

    states = [f"state_{i}" for i in range(se.se.architecture.state_size)]
    inputs = [ColSpec(DataType.double, name) for name in states]
    outputs = [ColSpec(DataType.float, f"next_{name}") for name in states]
    outputs += [ColSpec(DataType.float, name) for name in ("reward", "done")]
    return ModelSignature(Schema([*inputs, ColSpec(DataType.long, "action")]), Schema(outputs))


def _model_name(task_id: str) -> str:
    return "SE-" + re.sub("[/:]", "_", task_id)  # not allowed in MLflow's names

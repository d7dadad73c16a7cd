"""MLflow's model registry: the best SE of each task has the alias `best`, the newest one `newest`.

The best SE is the one with the highest mean score of fresh agents; of equal ones, the one whose
agents needed fewer training steps; then the newest. SEs of a built-in task with another step limit
or solved reward rank below all others, because their scores are not comparable.
"""

import re
import tempfile
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from bilevel.synthetic_env import StoredSE, load_se
from bilevel.tasks import BUILT_IN_TASKS
from cluster.tracking.view import RegisteredSE

#: Tags of a model version: time when the SE was saved, and the step limit and solved reward if
#: these are not the built-in task's.
_TIME, _VARIANT = "bilevel.time", "bilevel.task_variant"


def model_address(task_id: str, alias: str) -> str:
    """URI of a task's SE with that alias. `mlflow.pyfunc.load_model` of it returns an object whose
    `predict` runs the SE."""
    return f"models:/{_model_name(task_id)}@{alias}"


def register_se(client: Any, run_id: str, se: RegisteredSE) -> None:
    """Register an SE once as a version of the task's model, and move the aliases if it ranks
    higher. Raises InvalidInput for a damaged file, and MLflow's exceptions."""
    from mlflow.exceptions import MlflowException

    name = _model_name(se.task_id)
    folder = f"model-{se.file.version[:12]}"
    source = f"{client.get_run(run_id).info.artifact_uri}/{folder}"
    tags = {**se.tags, _TIME: repr(se.time), **_variant(_upload(client, run_id, se, folder))}
    with suppress(MlflowException):  # it exists
        client.create_registered_model(name)
    versions = client.search_model_versions(f"run_id = '{run_id}'")
    versions = [version for version in versions if version.source == source]
    if not versions:
        versions = [client.create_model_version(name, source, run_id, tags=tags)]
    holders = client.get_registered_model(name).aliases
    for alias, rank in _ranks(tags).items():
        holder = holders.get(alias)
        if holder is None or _ranks(client.get_model_version(name, holder).tags)[alias] < rank:
            client.set_registered_model_alias(name, alias, versions[0].version)


def _upload(client: Any, run_id: str, se: RegisteredSE, folder: str) -> StoredSE:
    """Upload an SE as an MLflow model, and return it."""
    import mlflow.pyfunc
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, DataType, Schema

    with tempfile.TemporaryDirectory() as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model, file = Path(temporary) / "model", Path(temporary) / se.file.path
        file.write_bytes(se.file.content())
        stored = load_se(file)
        # MLflow shows and checks the columns of the model's input and output.
        states = [f"state_{i}" for i in range(stored.se.architecture.state_size)]
        inputs = [ColSpec(DataType.double, name) for name in states]
        outputs = [f"next_{name}" for name in states] + ["reward", "done"]
        mlflow.pyfunc.save_model(
            model,
            loader_module="cluster.tracking.se_model",
            data_path=str(file),
            signature=ModelSignature(
                Schema([*inputs, ColSpec(DataType.long, "action")]),
                Schema([ColSpec(DataType.float, name) for name in outputs]),
            ),
            pip_requirements=[],  # loading needs this package anyway
        )
        client.log_artifacts(run_id, str(model), folder)
    return stored


def _variant(se: StoredSE) -> dict[str, str]:
    task, limit, solved = BUILT_IN_TASKS.get(se.task_id), se.step_limit, se.solved_reward
    if task is None or (task.step_limit, task.solved_reward) == (limit, solved):
        return {}
    return {_VARIANT: f"{limit} steps, solved at {solved:g}"}


def _ranks(tags: Mapping[str, str]) -> dict[str, tuple[float, ...]]:
    """Return the rank of a version by alias; the highest one has the alias."""
    saved, score = float(tags.get(_TIME, "-inf")), float(tags.get("final_score_mean", "-inf"))
    steps = float(tags.get("final_train_steps_mean", "inf"))
    return {"best": (_VARIANT not in tags, score, -steps, saved), "newest": (saved,)}


def _model_name(task_id: str) -> str:
    return "SE-" + re.sub("[/:]", "_", task_id)  # MLflow's names exclude these characters

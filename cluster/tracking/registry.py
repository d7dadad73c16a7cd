"""MLflow's model registry: the best SE of each task has the alias `best`, the newest one `newest`.

The best SE is the one with the highest mean score of fresh agents; of equal ones, the one whose
agents needed fewer training steps; then the newest.
"""

import re
import tempfile
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from cluster.storage.run_folder import BEST_FILE
from cluster.tracking.view import RegisteredSE

#: Tag of a model version: time when the SE was saved.
_TIME = "bilevel.time"


def model_address(task_id: str, alias: str) -> str:
    """URI of a task's SE with that alias. `mlflow.pyfunc.load_model` of it returns an object whose
    `predict` runs the SE."""
    return f"models:/{_model_name(task_id)}@{alias}"


def register_se(client: Any, run_id: str, se: RegisteredSE) -> None:
    """Register an SE once as a version of the task's model, and move the aliases if it ranks
    higher. Raises MLflow's exceptions."""
    from mlflow.exceptions import MlflowException

    name, folder = _model_name(se.task_id), f"model-{se.version[:12]}"
    _upload(client, run_id, se, folder)
    source = f"{client.get_run(run_id).info.artifact_uri}/{folder}"
    tags = {**se.tags, _TIME: repr(se.time)}
    with suppress(MlflowException):  # it exists
        client.create_registered_model(name)
    versions = [
        version
        for version in client.search_model_versions(f"run_id = '{run_id}'")
        if version.source == source
    ]
    if not versions:
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
            pip_requirements=[],  # loading needs this package anyway
        )
        client.log_artifacts(run_id, str(model), folder)


def _age(tags: Mapping[str, str]) -> tuple[float, ...]:
    return (float(tags.get(_TIME, "-inf")),)


def _quality(tags: Mapping[str, str]) -> tuple[float, ...]:
    score = float(tags.get("final_score_mean", "-inf"))
    steps = float(tags.get("final_train_steps_mean", "inf"))
    return score, -steps, *_age(tags)


def _model_name(task_id: str) -> str:
    return "SE-" + re.sub("[/:]", "_", task_id)  # MLflow's names exclude these characters

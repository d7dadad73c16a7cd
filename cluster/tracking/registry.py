"""MLflow's model registry: the best SE of each task has the alias `best`, the newest one `newest`.

The best SE is the one with the highest mean score of fresh agents; of equal ones, the one whose
agents needed fewer training steps; then the newest.
"""

import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from cluster.tracking.view import RegisteredSE

#: Tag of a model version: time when the SE was saved.
_TIME = "bilevel.time"


def model_address(task_id: str, alias: str) -> str:
    """URI of a task's SE with that alias, for `bilevel.load` and the command line."""
    return f"models:/{_model_name(task_id)}@{alias}"


def register_se(client: Any, run_id: str, se: RegisteredSE) -> None:
    """Register an SE, which is an artifact of the run, once as a version of the task's model, and
    move the aliases if it ranks higher. Raises MLflow's exceptions."""
    from mlflow.exceptions import MlflowException

    name = _model_name(se.task_id)
    source = f"{client.get_run(run_id).info.artifact_uri}/{se.folder}"
    tags = {**se.tags, _TIME: repr(se.time)}
    with suppress(MlflowException):  # it exists
        client.create_registered_model(name)
    versions = client.search_model_versions(f"run_id = '{run_id}'")
    versions = [version for version in versions if version.source == source]
    if not versions:
        versions = [client.create_model_version(name, source, run_id, tags=tags)]
    holders = client.get_registered_model(name).aliases
    for alias, rank in (("best", _quality), ("newest", _age)):
        holder = holders.get(alias)
        if holder is None or rank(client.get_model_version(name, holder).tags) < rank(tags):
            client.set_registered_model_alias(name, alias, versions[0].version)


def _age(tags: Mapping[str, str]) -> tuple[float, ...]:
    return (float(tags.get(_TIME, "-inf")),)


def _quality(tags: Mapping[str, str]) -> tuple[float, ...]:
    score = float(tags.get("final_score_mean", "-inf"))
    steps = float(tags.get("final_train_steps_mean", "inf"))
    return score, -steps, *_age(tags)


def _model_name(task_id: str) -> str:
    return "SE-" + re.sub("[/:]", "_", task_id)  # MLflow's names exclude these characters

"""A task's experiment in MLflow, and the pages that show it in the UI."""

import json
from collections.abc import Iterable
from typing import Any

from bilevel.errors import InvalidInput

#: Tag of a text that the UI shows above the runs of an experiment, or on a run's page.
NOTE = "mlflow.note.content"
#: Makes the UI open the experiment on its runs instead of on a page for chat traces.
_KIND = "mlflow.experimentKind"
#: The UI's page of all experiments. Without the workflow type it would open its pages for language
#: models.
HOME_PAGE = "/#/experiments?workflowType=machine_learning"
#: Name of a view of the UI, shared by all users, and the columns of its list of runs; those of the
#: hyperparameters that are tuned join them.
_VIEW = "bilevel"
_COLUMNS = (
    "attributes.`Created`",
    *(f"metrics.`{name}`" for name in ("objective", "budget", "score_mean", "final_score_mean")),
)
#: What the UI says of an experiment above its runs.
_DESCRIPTION = (
    "Synthetic environments (SEs) for {task}, learned by natural evolution strategies. "
    "`bilevel nes` makes one run; `bilevel bohb` makes one run for the study, which holds the "
    "results of the search, and below it one for each configuration; `bilevel evaluate` makes one "
    "run for all its agents, and `bilevel experiment` one for all of its SEs and agents. "
    "`score_mean` is the mean return on {task} of agents trained on the current SE, `objective` "
    "the expected core seconds to an SE that fresh agents confirm (less is better), and "
    "`final_score_mean` the mean return of fresh agents on the SE handed over."
)


def runs_page(experiment_id: str, run_id: str | None = None) -> str:
    """Path of the UI's page of a run, or of all runs of an experiment."""
    if run_id is None:
        view = f"viewStateShareKey={_VIEW}&workflowType=machine_learning"
        return f"/#/experiments/{experiment_id}/runs?{view}"
    return f"/#/experiments/{experiment_id}/runs/{run_id}?workflowType=machine_learning"


class Experiment:
    """The experiment of a task, created if missing; `location` is the folder of its artifacts, None
    where a server chooses it. Raises MLflow's exceptions, and InvalidInput if it was deleted in the
    UI."""

    def __init__(self, client: Any, task_id: str, location: str | None) -> None:
        self._client = client
        self._columns: list[str] = []  # of the shared view, as far as they are known
        self.id = self._find_or_create(task_id, location)
        self.show_columns(())

    def _find_or_create(self, task_id: str, location: str | None) -> str:
        from mlflow.exceptions import MlflowException

        found = self._client.get_experiment_by_name(task_id)
        if found is None:
            tags = {_KIND: "custom_model_development", NOTE: _DESCRIPTION.format(task=task_id)}
            try:
                return str(self._client.create_experiment(task_id, location, tags))
            except MlflowException:  # another process may have created it
                found = self._client.get_experiment_by_name(task_id)
                if found is None:
                    raise
        if found.lifecycle_stage == "deleted":
            raise InvalidInput(
                f"MLflow's experiment {task_id!r} was deleted, and its name is taken until MLflow "
                f"forgets it: `mlflow experiments restore --experiment-id {found.experiment_id}` "
                "(with MLFLOW_TRACKING_URI) brings it back"
            )
        return str(found.experiment_id)

    def show_columns(self, params: Iterable[str]) -> None:
        """Let the shared view have columns for these parameters, too."""
        from mlflow.exceptions import MlflowException

        wanted = [*_COLUMNS, *(f"params.`{param}`" for param in params)]
        if set(wanted) <= set(self._columns):
            return
        try:
            self._add_columns(wanted)
        except MlflowException:  # if another process has just set the tag for the first time
            self._add_columns(wanted)

    def _add_columns(self, wanted: list[str]) -> None:
        name = f"mlflow.sharedViewState.{_VIEW}"
        tags = self._client.get_experiment(self.id).tags
        before = json.loads(tags.get(name, "{}")).get("selectedColumns", [])
        columns = list(dict.fromkeys([*before, *wanted]))
        if columns != before:
            state = {"selectedColumns": columns, "orderByKey": "attributes.start_time"}
            text = json.dumps({**state, "orderByAsc": False})
            self._client.set_experiment_tag(self.id, name, text)
        self._columns = columns

    def forget(self) -> None:
        """Read again what MLflow has."""
        self._columns = []

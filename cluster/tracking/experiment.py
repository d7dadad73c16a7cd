"""A task's MLflow experiment, and the addresses of its pages in the UI."""

from typing import Any

from bilevel.errors import InvalidInput

#: MLflow's documented tag for the description of an experiment or a run.
NOTE = "mlflow.note.content"
_WORKFLOW = "workflowType=machine_learning"
#: Page of all experiments. Without the workflow type, the UI opens its pages for language models.
HOME_PAGE = f"/#/experiments?{_WORKFLOW}"
_DESCRIPTION = (
    "Synthetic environments (SEs) for {task}, learned by natural evolution strategies. "
    "`bilevel nes` creates one run; `bilevel bohb` creates one run for the study and a nested run "
    "for each configuration; `bilevel evaluate` and `bilevel experiment` create one run each. "
    "`score_mean` is the mean return on {task} of agents trained on the current SE. `objective` is "
    "the expected number of core seconds until fresh agents confirm an SE (lower is better). "
    "`final_score_mean` is the mean return of fresh agents on the best SE."
)


def runs_page(experiment_id: str, run_id: str | None = None) -> str:
    """Path of the page of a run, or of all runs of an experiment."""
    run = "" if run_id is None else f"/{run_id}"
    return f"/#/experiments/{experiment_id}/runs{run}?{_WORKFLOW}"


def experiment_of(client: Any, task_id: str, location: str | None) -> str:
    """Return the ID of a task's experiment, and create it if missing.

    `location` is the folder of its artifacts; None leaves the choice to the server. Raises MLflow's
    exceptions, and InvalidInput if the experiment was deleted in the UI.
    """
    from mlflow.exceptions import MlflowException

    found = client.get_experiment_by_name(task_id)
    if found is None:
        tags = {NOTE: _DESCRIPTION.format(task=task_id)}
        try:
            return str(client.create_experiment(task_id, location, tags))
        except MlflowException:  # another client of the server may have created it
            found = client.get_experiment_by_name(task_id)
            if found is None:
                raise
    if found.lifecycle_stage == "deleted":
        raise InvalidInput(
            f"MLflow's experiment {task_id!r} was deleted; restore it with "
            f"`mlflow experiments restore --experiment-id {found.experiment_id}` "
            "(MLFLOW_TRACKING_URI must be set)"
        )
    return str(found.experiment_id)

"""Finding an SE file on this machine or in MLflow."""

import re
from pathlib import Path

from bilevel.errors import InvalidInput, first_line

#: A version of a registered model, by its alias or number.
_MODEL = re.compile(r"models:/([^/@]+)(?:@(.+)|/(\d+))")

#: Addresses that MLflow resolves.
_MLFLOW = re.compile(r"(models|runs|mlflow-artifacts):/")


def is_of_mlflow(address: str | Path) -> bool:
    """Whether an address is one that MLflow resolves."""
    return _MLFLOW.match(str(address)) is not None


def se_file(address: str | Path, tracking_uri: str | None = None) -> Path:
    """The SE file at a path, or at MLflow's address of a registered model (`models:/NAME@ALIAS`)
    or of an artifact of a run (`runs:/ID/best_se.safetensors`), which is downloaded from the MLflow
    at `tracking_uri`, or else from the one that MLflow is set to.

    Raises InvalidInput if MLflow has none there.
    """
    if not is_of_mlflow(address):
        return Path(address)
    from mlflow.artifacts import download_artifacts
    from mlflow.exceptions import MlflowException

    try:
        located = _located(str(address), tracking_uri)
        found = Path(download_artifacts(located, tracking_uri=tracking_uri))
    except (MlflowException, OSError) as error:
        raise InvalidInput(f"MLflow has no SE at {str(address)!r}: {first_line(error)}") from None
    files = [found] if found.is_file() else sorted(found.rglob("*.safetensors"))
    if len(files) != 1:
        raise InvalidInput(f"{str(address)!r} holds {len(files)} SE files: give the address of one")
    return files[0]


def _located(address: str, tracking_uri: str | None) -> str:
    """Where the registry at `tracking_uri` has the files of a registered model: MLflow itself would
    ask the registry that it is set to. Other addresses stay. Raises MLflow's exceptions."""
    model = _MODEL.fullmatch(address)
    if model is None or tracking_uri is None:
        return address
    from mlflow import MlflowClient

    client, (name, alias, version) = MlflowClient(tracking_uri, tracking_uri), model.groups()
    if alias is not None:
        version = client.get_model_version_by_alias(name, alias).version
    return str(client.get_model_version_download_uri(name, version))

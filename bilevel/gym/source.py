"""Finding an SE file on this machine or in MLflow."""

import re
from pathlib import Path

from bilevel.errors import InvalidInput, first_line

#: Addresses that MLflow resolves, with the tracking server that it is set to.
_MLFLOW = re.compile(r"(models|runs|mlflow-artifacts):/")


def se_file(address: str | Path) -> Path:
    """The SE file at a path, or at MLflow's address of a registered model (`models:/NAME@ALIAS`)
    or of an artifact of a run (`runs:/ID/best_se.safetensors`), which is downloaded.

    Raises InvalidInput if MLflow has none there.
    """
    if not _MLFLOW.match(str(address)):
        return Path(address)
    from mlflow.artifacts import download_artifacts
    from mlflow.exceptions import MlflowException

    try:
        found = Path(download_artifacts(str(address)))
    except (MlflowException, OSError) as error:
        raise InvalidInput(f"MLflow has no SE at {str(address)!r}: {first_line(error)}") from None
    files = [found] if found.is_file() else sorted(found.rglob("*.safetensors"))
    if len(files) != 1:
        raise InvalidInput(f"{str(address)!r} holds {len(files)} SE files: give the address of one")
    return files[0]

"""SE files by their address: a path, a name in the zoo, or an artifact in MLflow."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bilevel.errors import InvalidInput, first_line
from bilevel.synthetic_env.storage import StoredSE, load_se
from bilevel.zoo import ENTRIES, zoo_file


def load(address: str | Path) -> StoredSE:
    """Load an SE from a file, from the zoo or from MLflow.

    `address` is one of

    - the path of an SE file, `best_se.safetensors`
    - the name of an SE of the zoo, `CartPole-v0` (`./CartPole-v0` is a path)
    - a model in MLflow's registry, `models:/NAME@ALIAS` or `models:/NAME/VERSION`
    - an artifact of a run in MLflow, `runs:/ID/best_se.safetensors`

    The environment variable MLFLOW_TRACKING_URI or `mlflow.set_tracking_uri` selects MLflow's
    server. Loading never executes code from the file.

    Raises InvalidInput if there is no SE at the address, or if its file is damaged.
    """
    return load_se(se_file(address))


def se_file(address: str | Path, tracking_uri: str | None = None) -> Path:
    """Return the SE file at an address (see `load`); files in MLflow are downloaded.

    Raises InvalidInput if there is none.
    """
    if address in ENTRIES:
        return zoo_file(str(address))
    if is_mlflow_address(address):
        return _downloaded(str(address), tracking_uri)
    if not os.path.exists(address):  # noqa: PTH110 (Path.exists raises if the name is too long)
        raise InvalidInput(
            f"no SE file at {str(address)!r}: give a path, MLflow's address (runs:/..., "
            f"models:/...) or a name of the zoo, {' or '.join(ENTRIES)}"
        )
    return Path(address)


def is_mlflow_address(address: str | Path) -> bool:
    """Return whether MLflow resolves an address."""
    return re.match("(models|runs|mlflow-artifacts):/", str(address)) is not None


def pinned(address: str, tracking_uri: str | None = None) -> str:
    """Replace the alias of a registered model, which may move, by its current version.

    Other addresses are returned unchanged. Raises InvalidInput if there is no such version.
    """
    alias = re.fullmatch("models:/([^/@]+)@(.+)", address)
    if alias is None:
        return address
    from mlflow import MlflowClient

    with _mlflow_errors(address):
        client = MlflowClient(tracking_uri, tracking_uri)
        return f"models:/{alias[1]}/{client.get_model_version_by_alias(alias[1], alias[2]).version}"


def _downloaded(address: str, tracking_uri: str | None) -> Path:
    from mlflow import MlflowClient, is_tracking_uri_set
    from mlflow.artifacts import download_artifacts

    if tracking_uri is None and not is_tracking_uri_set():  # MLflow would create a database here
        raise InvalidInput(f"{address!r} needs MLflow: set MLFLOW_TRACKING_URI")
    source = pinned(address, tracking_uri)
    with _mlflow_errors(address):
        if model := re.fullmatch("models:/([^/@]+)/([0-9]+)", source):
            # download_artifacts would ask the registry of MLflow's configuration.
            client = MlflowClient(tracking_uri, tracking_uri)
            source = client.get_model_version_download_uri(model[1], model[2])
        found = Path(download_artifacts(source, tracking_uri=tracking_uri))
    files = [found] if found.is_file() else sorted(found.rglob("*.safetensors"))
    if len(files) != 1:
        raise InvalidInput(f"{address!r} has {len(files)} SE files: give the address of one file")
    return files[0]


@contextmanager
def _mlflow_errors(address: str) -> Iterator[None]:
    """Convert MLflow's errors to InvalidInput with the address."""
    from mlflow.exceptions import MlflowException

    try:
        yield
    except (MlflowException, OSError) as error:
        raise InvalidInput(f"MLflow has no SE at {address!r}: {first_line(error)}") from None

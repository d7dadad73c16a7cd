"""Finding an SE file: on this machine, in the zoo or in MLflow."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bilevel.errors import InvalidInput, first_line
from bilevel.synthetic_env.storage import StoredSE, load_se
from bilevel.zoo import ENTRIES, zoo_file

#: A version of a registered model, by its number or alias.
_MODEL = re.compile(r"models:/([^/@]+)(?:/(\d+)|@(.+))")

#: Addresses that MLflow resolves.
_MLFLOW = re.compile(r"(models|runs|mlflow-artifacts):/")


def is_of_mlflow(address: str | Path) -> bool:
    """Whether an address is one that MLflow resolves."""
    return _MLFLOW.match(str(address)) is not None


def pinned(address: str, tracking_uri: str | None = None) -> str:
    """MLflow's address with the number of a model's version in place of its alias, which may move
    on. Raises InvalidInput if MLflow has no such version, and for another address of a model."""
    if not address.startswith("models:"):
        return address
    model = _MODEL.fullmatch(address)
    if model is None:
        raise InvalidInput(
            f"{address!r} is no version of a model: allowed are models:/NAME@ALIAS and "
            "models:/NAME/VERSION"
        )
    name, version, alias = model.groups()
    if version is None:
        from mlflow import MlflowClient

        client = MlflowClient(tracking_uri, tracking_uri)
        with _told(address):
            version = client.get_model_version_by_alias(name, alias).version
    return f"models:/{name}/{version}"


def se_file(address: str | Path, tracking_uri: str | None = None) -> Path:
    """The SE file of that name in the zoo (`./NAME` is a file here), at a path, or at MLflow's
    address of a registered model (`models:/NAME@ALIAS` or `models:/NAME/VERSION`) or of an artifact
    of a run (`runs:/ID/best_se.safetensors`), which is downloaded from the MLflow at
    `tracking_uri`, or else from the one that MLflow is set to.

    Raises InvalidInput if there is none, or MLflow is set to nothing.
    """
    if not isinstance(address, str | os.PathLike):
        raise InvalidInput(
            "an SE is given by its file's path, its name in the zoo or MLflow's address; got "
            f"{address!r}"
        )
    if isinstance(address, str) and address in ENTRIES:
        return zoo_file(address)
    if not is_of_mlflow(address):
        if not os.path.exists(address):  # noqa: PTH110 (Path's raises for a name too long)
            raise InvalidInput(
                f"no SE file at {str(address)!r}: give a path, MLflow's address (runs:/..., "
                f"models:/...) or a name of the zoo, {' or '.join(ENTRIES)}"
            )
        return Path(address)
    from mlflow import is_tracking_uri_set
    from mlflow.artifacts import download_artifacts

    if tracking_uri is None and not is_tracking_uri_set():  # MLflow would make a new database here
        raise InvalidInput(
            f"{str(address)!r} needs an MLflow: set MLFLOW_TRACKING_URI to the one that has it, "
            "such as sqlite:////home/me/bilevel/runs/mlflow.db or http://localhost:5000"
        )
    with _told(address):
        located = _located(pinned(str(address), tracking_uri), tracking_uri)
        found = Path(download_artifacts(located, tracking_uri=tracking_uri))
    files = [found] if found.is_file() else sorted(found.rglob("*.safetensors"))
    if len(files) != 1:
        raise InvalidInput(f"{str(address)!r} holds {len(files)} SE files: give the address of one")
    return files[0]


def load(address: str | Path) -> StoredSE:
    """Read an SE: a file at a path, the one of that name in the zoo, or what MLflow has at an
    address (`se_file`).

    Raises InvalidInput if it is missing, damaged, or not an SE file.
    """
    return load_se(se_file(address))


def _located(address: str, tracking_uri: str | None) -> str:
    """Where the registry at `tracking_uri` has the files of a version of a model: MLflow itself
    would ask the registry that it is set to. Other addresses stay. Raises MLflow's exceptions."""
    model = _MODEL.fullmatch(address)
    if model is None or tracking_uri is None:
        return address
    from mlflow import MlflowClient

    client = MlflowClient(tracking_uri, tracking_uri)
    return str(client.get_model_version_download_uri(model[1], model[2]))


@contextmanager
def _told(address: str | Path) -> Iterator[None]:
    """Raise errors of MLflow's as InvalidInput that names the address."""
    from mlflow.exceptions import MlflowException

    try:
        yield
    except (MlflowException, OSError) as error:
        raise InvalidInput(f"MLflow has no SE at {str(address)!r}: {first_line(error)}") from None

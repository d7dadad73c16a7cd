"""Programs that the packages of this installation bring along."""

import os
import shutil
import sys
import sysconfig
from pathlib import Path

from bilevel.errors import InvalidInput


def program(name: str) -> str:
    """Path of a program, such as `mlflow`: beside the interpreter, among the scripts of the system
    or the user, or on the path. Raises InvalidInput."""
    folders = [
        str(Path(sys.executable).parent),
        sysconfig.get_path("scripts"),
        sysconfig.get_path("scripts", sysconfig.get_preferred_scheme("user")),
        os.environ.get("PATH", ""),
    ]
    found = shutil.which(name, path=os.pathsep.join(folders))
    if found is None:
        raise InvalidInput(f"the program {name!r} is not installed beside {sys.executable!r}")
    return found

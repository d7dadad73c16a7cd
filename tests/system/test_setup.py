"""The virtual environment that `make setup` creates."""

import subprocess
import sys
from pathlib import Path
from shutil import copy

from tests.documents import ROOT


def test_setup_repairs_an_interrupted_setup(tmp_path: Path) -> None:
    """An interruption in the first seconds leaves a Python without pip."""
    copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "constraints.txt").touch()  # nothing to install: `make` fails after the first step
    half = tmp_path / ".venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", half], check=True)
    pip = [str(half / "bin" / "python"), "-m", "pip", "--version"]
    assert subprocess.run(pip, capture_output=True, check=False).returncode != 0
    command = ["make", "setup", f"PYTHON={sys.executable}"]
    subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert subprocess.run(pip, capture_output=True, check=False).returncode == 0

import sys
import sysconfig
from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.services.programs import program


def test_a_program_is_found_where_pip_puts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/none")
    (tmp_path / "elsewhere").touch(mode=0o755)  # not beside the interpreter
    for scheme in ((), (sysconfig.get_preferred_scheme("user"),)):  # also `pip install --user`
        with monkeypatch.context() as context:
            found = {scheme: str(tmp_path)}
            context.setattr("sysconfig.get_path", lambda _, *given, f=found: f.get(given, "/none"))
            assert program("elsewhere") == str(tmp_path / "elsewhere")
            assert Path(program("mlflow")).parent == Path(sys.executable).parent
    with pytest.raises(InvalidInput, match="the program 'elsewhere' is not installed beside"):
        program("elsewhere")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert program("elsewhere") == str(tmp_path / "elsewhere")

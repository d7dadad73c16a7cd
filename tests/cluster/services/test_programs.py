from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.services.programs import program


def test_a_program_is_found_where_pip_puts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert Path(program("mlflow")).name == "mlflow"
    (tmp_path / "elsewhere").touch(mode=0o755)  # not beside the interpreter
    with monkeypatch.context() as context:  # as by `pip install --user`
        context.setattr("sysconfig.get_path", lambda *_: str(tmp_path))
        assert program("elsewhere") == str(tmp_path / "elsewhere")
    with pytest.raises(InvalidInput, match="the program 'elsewhere' is not installed beside"):
        program("elsewhere")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert program("elsewhere") == str(tmp_path / "elsewhere")

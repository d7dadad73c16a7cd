"""The folder of compiled kernels."""

from pathlib import Path

import numba
import pytest

from bilevel.kernels import jit


@pytest.mark.parametrize(
    ("setting", "home", "expected"),
    [
        ("{}", "/proc/none", "{}"),
        ("/proc/none", "{}", "{}/.cache/bilevel"),
        ("", "/proc/none", "{}"),  # a temporary folder
    ],
)
def test_folders_of_a_read_only_package(
    setting: str, home: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if root had installed it."""
    monkeypatch.setattr(jit, "__file__", "/proc/bilevel/kernels/jit.py")
    monkeypatch.setattr(Path, "read_bytes", lambda _: b"")
    monkeypatch.setattr(numba.config, "CACHE_DIR", setting.format(tmp_path))
    monkeypatch.setenv("HOME", home.format(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert str(jit.cache_folder().parent) == expected.format(tmp_path)

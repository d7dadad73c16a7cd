"""The folder of compiled kernels."""

from pathlib import Path

import numba
import pytest

from bilevel.kernels import jit


@pytest.fixture(autouse=True)
def _package_is_read_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy of the package in a place that nobody can write, like one that root has installed."""
    monkeypatch.setattr(jit, "__file__", "/proc/bilevel/kernels/jit.py")
    monkeypatch.setattr(Path, "read_bytes", lambda _: b"")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")


def test_numbas_setting_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert jit.cache_folder().parent == tmp_path


def test_the_users_cache_is_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", "/proc/none")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert jit.cache_folder().parent == tmp_path / ".cache" / "bilevel"


def test_a_temporary_folder_is_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a container whose user has no home."""
    monkeypatch.setenv("HOME", "/proc/none")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    first, second = jit.cache_folder(), jit.cache_folder()
    assert first != second
    assert {first.parent, second.parent} == {tmp_path}

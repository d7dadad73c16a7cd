"""Where compiled kernels are kept."""

import os
from pathlib import Path

import numba
import pytest

from bilevel.kernels import jit


def test_the_cache_is_where_numba_is_told_to_keep_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert Path(jit._cache_folder()).parent == tmp_path


def test_where_the_package_cannot_be_written_the_cache_is_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a package that root has installed. A folder that Numba is told of, and that cannot be
    made, is left alone."""
    package = Path(jit.__file__).parent
    monkeypatch.setattr(numba.config, "CACHE_DIR", "/proc/none")
    monkeypatch.setattr(
        os, "access", lambda path, mode: package not in (Path(path), *Path(path).parents)
    )
    monkeypatch.setenv("HOME", str(tmp_path))
    assert Path(jit._cache_folder()).parent == tmp_path / ".cache" / "bilevel"


def test_where_nothing_can_be_written_the_cache_is_the_process_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a container's user without a home, and with a package that root has installed."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setenv("HOME", "/proc/none")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    first, second = jit._cache_folder(), jit._cache_folder()
    assert first != second
    assert {Path(first).parent, Path(second).parent} == {tmp_path}

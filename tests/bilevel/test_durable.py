"""Atomic and durable file writes."""

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from bilevel.durable import checksum, write_aside, write_file
from bilevel.errors import StorageFailure
from tests.small_disk import on_small_disk, small_disks


def test_a_file_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file"
    write_aside(path, b"one")
    write_aside(path, b"two")
    assert path.read_bytes() == b"two"
    assert list(path.parent.iterdir()) == [path]


def test_threads_may_write_the_same_file(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 250)  # near the maximum length of a name
    contents = [bytes([i]) * 100_000 for i in range(8)]
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda content: write_aside(path, content), contents * 5))
    assert path.read_bytes() in contents
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupt_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    write_aside(path, b"old")

    def interrupt(descriptor: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_aside(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(not small_disks(), reason="no small disk can be mounted here")
def test_a_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    script = f"""{sys.executable} - <<'END'
from pathlib import Path
from bilevel.durable import write_aside
from bilevel.errors import StorageFailure
path = Path({str(disk)!r}) / "file"
write_aside(path, b"old" * 100)
try:
    write_aside(path, b"new" * 100_000)
except StorageFailure as failure:
    print(failure)
assert path.read_bytes() == b"old" * 100
assert list(path.parent.iterdir()) == [path]
write_aside(path, b"new")
END"""
    result = on_small_disk(disk, "64k", script)
    assert result.returncode == 0, result.stderr
    assert result.stdout == f"cannot write '{disk}/file': No space left on device\n"


def test_paths_from_users(tmp_path: Path) -> None:
    """A misspelled folder is not created; a symbolic link is followed."""
    for wrong in (tmp_path / "none" / "file", tmp_path):
        with pytest.raises(StorageFailure, match=r"cannot write .*: (No such file|Is a directory)"):
            write_file(wrong, b"new")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_file(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "link"]


def test_the_checksum_depends_on_the_ends_of_parts() -> None:
    assert checksum(b"ab", b"c") != checksum(b"a", b"bc")

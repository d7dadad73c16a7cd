import errno
import os
import stat
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from bilevel.durable import checksum, sync, write_aside, write_file
from bilevel.errors import InvalidInput
from tests.small_disk import on_small_disk, small_disks


def test_a_file_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file"
    write_aside(path, b"one")
    write_aside(path, b"two")
    assert path.read_bytes() == b"two"
    assert list(path.parent.iterdir()) == [path]


def test_several_threads_may_write_a_file_whose_permissions_stay(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 250)  # its name may be as long as the file system allows
    write_aside(path, b"first")
    path.chmod(0o600)
    contents = [bytes([i]) * 100_000 for i in range(8)]
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda content: write_aside(path, content), contents * 5))
    assert path.read_bytes() in contents
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert list(tmp_path.iterdir()) == [path]


def test_ctrl_c_leaves_the_old_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    write_aside(path, b"old")

    def interrupted(descriptor: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_aside(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_system_that_does_not_flush_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its refusal of a folder is ignored, that of a file is not."""
    flush, refused = os.fsync, list[bool]()

    def refuse(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode) or refused:
            raise OSError(errno.EINVAL, "Invalid argument")
        flush(descriptor)

    monkeypatch.setattr(os, "fsync", refuse)
    write_aside(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"new"
    refused.append(True)
    with pytest.raises(OSError, match="Invalid argument"):
        write_aside(tmp_path / "file", b"newer")
    with pytest.raises(OSError, match="Invalid argument"):
        sync(tmp_path / "file")


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


def test_a_path_in_the_way_is_no_failure_of_the_disk(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FileExistsError):
        write_aside(tmp_path / "file" / "inside", b"")
    (tmp_path / "folder").mkdir()
    with pytest.raises(IsADirectoryError):
        write_aside(tmp_path / "folder", b"")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


def test_a_file_that_a_user_names(tmp_path: Path) -> None:
    """A mistyped folder is told, not made; a link stays one."""
    for wrong in (tmp_path / "none" / "file", tmp_path):
        with pytest.raises(InvalidInput, match=r"cannot write .*: (No such file|Is a directory)"):
            write_file(wrong, b"new")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_file(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "link"]


def test_checksum_tells_where_a_part_ends() -> None:
    assert checksum(b"ab", b"c") != checksum(b"a", b"bc")
    assert len(checksum()) == 64

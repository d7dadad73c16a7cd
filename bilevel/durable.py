"""Atomic file writes: write a temporary file, flush it, and rename it into place."""

import contextlib
import errno
import hashlib
import os
import secrets
from pathlib import Path

from bilevel.errors import StorageFailure


def write_aside(path: Path, data: bytes) -> None:
    """Replace a file atomically and durably. If the write fails, the old file is unchanged, and
    StorageFailure is raised."""
    temporary = path.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        sync(path.parent)
    except BaseException as error:  # also KeyboardInterrupt
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError):
            raise StorageFailure.of(path, error) from None
        raise


def write_file(path: Path, content: bytes) -> None:
    """Write a file at a path that the user gave; symbolic links are followed. Raises StorageFailure
    if the folder does not exist or the file cannot be written."""
    try:
        path.parent.resolve(strict=True)
    except OSError as error:
        raise StorageFailure.of(path, error) from None
    write_aside(path.resolve(), content)


def sync(path: Path) -> None:
    """Flush a file or folder to disk; renames are stored in the folder, not in the file."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network file systems cannot flush folders.
        if not path.is_dir() or error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def checksum(*parts: bytes) -> str:
    """Return the SHA-256 of the parts, each preceded by its length, in hexadecimal."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()

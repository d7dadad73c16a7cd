"""Atomic file writes: to a temporary file that is flushed and renamed into place."""

import contextlib
import errno
import hashlib
import os
import secrets
from pathlib import Path

from bilevel.errors import InvalidInput, StorageFailure

#: Errors of a disk that is full, read-only, broken, not ours or (if shared) unreachable: writing
#: other files would fail too.
DISK_ERRORS = {
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EROFS,
    errno.EIO,
    errno.EACCES,
    errno.EPERM,
    errno.ESTALE,
    errno.ETIMEDOUT,
    errno.ENOTCONN,
    errno.EHOSTDOWN,
}


def write_aside(path: Path, data: bytes) -> None:
    """Replace a file atomically and durably.

    Raises StorageFailure, with the old file untouched, if the disk is full or broken, and OSError
    if only this path cannot be written.
    """
    aside = path.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with aside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        with contextlib.suppress(FileNotFoundError):
            before = path.stat()
            if before.st_uid == os.geteuid():  # another user's may be closed to this one
                aside.chmod(before.st_mode & 0o777)
        aside.replace(path)
        sync(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            aside.unlink()
        if error.errno in DISK_ERRORS:
            raise StorageFailure.of(path, error) from None
        raise
    except BaseException:  # Ctrl-C
        with contextlib.suppress(OSError):
            aside.unlink()
        raise


def write_file(path: Path, content: bytes) -> None:
    """Write a file that a user names, whole or not at all; a link stays a link. Raises InvalidInput
    if its folder does not exist or the name is a folder's, and StorageFailure if the disk cannot be
    written."""
    try:
        path.parent.resolve(strict=True)
        write_aside(path.resolve(), content)
    except OSError as error:
        raise InvalidInput(f"cannot write {str(path)!r}: {error.strerror or error}") from None


def sync(path: Path) -> None:
    """Flush a file to disk, or a folder: renames are stored in the folder, not in the file."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if not path.is_dir() or error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise  # else a file system that does not flush folders
    finally:
        os.close(descriptor)


def checksum(*parts: bytes) -> str:
    """SHA-256 in hexadecimal of the parts, each preceded by its length."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()

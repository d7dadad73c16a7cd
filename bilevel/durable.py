"""Atomic file writes: write a temporary file, flush it, and rename it into place."""

import contextlib
import errno
import hashlib
import os
import secrets
from pathlib import Path

from bilevel.errors import InvalidInput, StorageFailure

#: Errors of a single path. After any other error, the disk cannot store other files either.
_PATH_ERRORS = {errno.EEXIST, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG}
_PATH_ERRORS |= {errno.ELOOP, errno.EINVAL}


def write_aside(path: Path, data: bytes) -> None:
    """Replace a file atomically and durably.

    If the write fails, the old file is unchanged. Raises StorageFailure if the disk is full or
    broken, and OSError if only this path cannot be written.
    """
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
        if isinstance(error, OSError) and error.errno not in _PATH_ERRORS:
            raise StorageFailure.of(path, error) from None
        raise


def write_file(path: Path, content: bytes) -> None:
    """Write a file at a path that the user gave; symbolic links are followed.

    Raises InvalidInput if the folder does not exist or the path is a folder, and StorageFailure if
    the disk cannot be written.
    """
    try:
        path.parent.resolve(strict=True)
        write_aside(path.resolve(), content)
    except OSError as error:
        raise InvalidInput(f"cannot write {str(path)!r}: {error.strerror or error}") from None


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

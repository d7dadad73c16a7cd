"""Files that are whole or not there: written aside, flushed, renamed into place."""

import contextlib
import errno
import hashlib
import os
from pathlib import Path

from bilevel.errors import StorageFailure

#: What a disk answers that is full, read-only, broken, another's, or (one that nodes
#: share) away: no other file fares better.
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
    """Replace a file at once or not at all, durably, whatever happens meanwhile.

    Raises StorageFailure, with the old file untouched, if the disk takes no more;
    OSError if it is this path that cannot be written.
    """
    aside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with aside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        aside.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            aside.unlink()
        if error.errno in DISK_ERRORS:
            raise StorageFailure.of(path, error) from None
        raise


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable: a rename is in the folder, not in the file."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def checksum(*parts: bytes) -> str:
    """SHA-256 of the parts, each with its length, in hexadecimal."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()

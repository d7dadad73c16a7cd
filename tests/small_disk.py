"""A disk that fills up, for tests: a small tmpfs in its own mount namespace."""

import shutil
import subprocess
from functools import cache
from pathlib import Path


def on_small_disk(
    folder: Path, size: str, script: str, timeout: float = 60
) -> subprocess.CompletedProcess[str]:
    """Run a bash script while a tmpfs of `size` (such as "64k") is mounted on `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    mounted = f"mount -t tmpfs -o size={size} none {folder} && {script}"
    command = ["unshare", "--map-root-user", "--mount", "bash", "-c", mounted]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


@cache
def small_disks() -> bool:
    """Return whether this machine allows mounting a tmpfs."""
    return (
        shutil.which("unshare") is not None
        and subprocess.run(
            ["unshare", "--map-root-user", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"],
            capture_output=True,
            check=False,
        ).returncode
        == 0
    )

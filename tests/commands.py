"""`bilevel ARGUMENTS` as tests give it: in a process of its own that need not import all of it
again, or by the console script itself."""

import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.faults import lives

#: The console script.
BILEVEL = str(Path(sys.executable).with_name("bilevel"))


def run_bilevel(
    *arguments: str | Path, cwd: Path | None = None, timeout: float = 280
) -> subprocess.CompletedProcess[str]:
    """The command to its end. Raises TimeoutError, with what it has written."""
    words = [str(argument) for argument in arguments]
    with tempfile.TemporaryDirectory() as folder:
        out, errors = Path(folder) / "out", Path(folder) / "errors"
        process = lives.start(words, out, errors, cwd)
        process.join(timeout)
        alive = process.is_alive()
        if alive:
            process.kill()
            process.join()
        written = out.read_text() if out.exists() else "", errors.read_text()
        if alive:
            raise TimeoutError(f"bilevel {' '.join(words)}: {written}")
        return subprocess.CompletedProcess(words, process.exitcode or 0, *written)

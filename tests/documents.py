"""Commands, code and paths in the documents."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent

#: README, CONTRIBUTING and the pages of docs.
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])

_FENCED = re.compile(r"^```([^`\n]*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def python_blocks(document: str) -> list[str]:
    """Return the Python blocks of a document, given by its path in the repository."""
    return _blocks(document, "python")


def documented_code(document: str) -> str:
    """Return the first Python block of a page of docs."""
    return python_blocks(f"docs/{document}")[0]


def documented_agent() -> str:
    """Return the source of the example agent in docs/agents.md."""
    return documented_code("agents.md")


def toml_block(document: str) -> str:
    """Return the first TOML block of a document."""
    return _blocks(document, "toml")[0]


def inline_code(document: Path) -> list[str]:
    """Return the inline code of a document, outside fenced blocks."""
    text = _FENCED.sub("", document.read_text())
    return [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", text)]


def commands(document: Path) -> Iterator[list[str]]:
    """Yield the words of each shell command in a document, inline or in a fenced block."""
    blocks = [block for language, block in _FENCED.findall(document.read_text()) if not language]
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    for line in [*lines, *inline_code(document)]:
        try:
            words = shlex.split(line, comments=True)
        except ValueError:  # no command: an apostrophe
            continue
        if words:
            yield words


def _blocks(document: str, language: str) -> list[str]:
    found = _FENCED.findall((ROOT / document).read_text())
    return [block for of_block, block in found if of_block == language]

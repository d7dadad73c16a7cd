"""Code that tests read from the documents."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def python_blocks(document: str) -> list[str]:
    """The blocks of Python in a document, given by its path in the repository."""
    return re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(), re.DOTALL)


def documented_code(document: str) -> str:
    """The first block of Python in a document of docs."""
    return python_blocks(f"docs/{document}")[0]


def documented_agent() -> str:
    """Source of the example agent in docs/agents.md."""
    return documented_code("agents.md")

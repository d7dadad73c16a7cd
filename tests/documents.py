"""Code that tests read from the documents."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def documented_code(document: str) -> str:
    """The first block of Python in a document of docs."""
    found = re.search(r"```python\n(.*?)```", (ROOT / "docs" / document).read_text(), re.DOTALL)
    assert found is not None
    return found[1]


def documented_agent() -> str:
    """Source of the example agent in docs/agents.md."""
    return documented_code("agents.md")

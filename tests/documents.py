"""Code that tests read from the documents."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def documented_agent() -> str:
    """Source of the example agent in docs/agents.md."""
    found = re.search(r"```python\n(.*?)```", (ROOT / "docs" / "agents.md").read_text(), re.DOTALL)
    assert found is not None
    return found[1]

"""Sphinx configuration of the documentation, `make docs`."""

import re
from typing import Any, get_args, get_origin

from sphinx.pycode import ModuleAnalyzer

from bilevel import __version__, hyperparameters

project = "bilevel"
release = __version__
html_title = f"bilevel {__version__}"
html_theme = "furo"
html_show_copyright = False
default_role = "code"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]

myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "description"
# References to type aliases of other libraries cannot be resolved.
suppress_warnings = ["ref.python"]

#: Files outside this folder that a page includes, and that page.
_INCLUDED = {"README.md": "using.md", "CONTRIBUTING.md": "contributing.md"}


def _rewrite_links(app: object, page: str, content: list[str]) -> None:
    """Point links to included files to their pages, and links to other files to copies of them."""
    for file, target in _INCLUDED.items():
        content[0] = content[0].replace(f"](../{file}", f"]({target}")
    content[0] = re.sub(r"\]\(\.\./((?:cluster|benchmarks)/\S+?)\)", r"](path:../\1)", content[0])


def _rewrite_included_links(app: object, path: object, page: str, content: list[str]) -> None:
    """Adapt links of an included file, which are relative to the repository's root."""
    content[0] = content[0].replace("](docs/", "](")
    for file, target in _INCLUDED.items():
        content[0] = content[0].replace(f"]({file}", f"]({target}")


def _fields_as_tables(app: object, page: str, content: list[str]) -> None:
    """Replace `<!-- fields: CLASS -->` by a table of the fields of a class of hyperparameters."""
    content[0] = re.sub(r"<!-- fields: (\w+) -->", lambda m: _fields(m[1]), content[0])


def _fields(name: str) -> str:
    kind: Any = getattr(hyperparameters, name)
    comments: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if base.__module__.startswith("bilevel"):
            found = ModuleAnalyzer.for_module(base.__module__).find_attr_docs()
            comments |= {
                field: " ".join(lines).strip()
                for (owner, field), lines in found.items()
                if owner == base.__name__
            }
    rows = [
        f"| `{field}` | {_allowed(spec)} | {comments.get(field, '')} |"
        for field, spec in kind.__pydantic_fields__.items()
    ]
    return "\n".join(["| field | allowed | meaning |", "| --- | --- | --- |", *rows])


def _allowed(spec: Any) -> str:
    """Return the allowed values of a field."""
    if get_origin(spec.annotation) is not None:
        return ", ".join(f"`{value}`" for value in get_args(spec.annotation))
    if spec.annotation is bool:
        return "true, false"
    ends = {
        end: getattr(rule, end)
        for rule in spec.metadata
        for end in ("ge", "gt", "le")
        if hasattr(rule, end)
    }
    low = f"above {ends['gt']}" if "gt" in ends else ends["ge"]
    return f"{spec.annotation.__name__}, {low} to {ends['le']}"


def setup(app):  # type: ignore[no-untyped-def]
    """Register the functions above."""
    app.connect("source-read", _rewrite_links)
    app.connect("source-read", _fields_as_tables)
    app.connect("include-read", _rewrite_included_links)

"""Settings of the documentation site: `make docs`."""

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
# Aliases of other libraries' types have no page here.
suppress_warnings = ["ref.python"]

#: Files outside this folder that pages include, by the page that does.
_INCLUDED = {"README.md": "using.md", "CONTRIBUTING.md": "contributing.md"}


def _links_to_pages(app: object, page: str, content: list[str]) -> None:
    """Let links to included files lead to their pages; in the repository they lead to the files."""
    for file, target in _INCLUDED.items():
        content[0] = content[0].replace(f"](../{file}", f"]({target}")
    content[0] = re.sub(r"\]\(\.\./(cluster/deploy/\S+?)\)", r"](path:../\1)", content[0])
    content[0] = re.sub(
        r"(?<!\!)\[([^]]*)\]\(\.\./(benchmarks/\S+?)\)", r"[\1](path:../\2)", content[0]
    )


def _includes(app: object, path: object, page: str, content: list[str]) -> None:
    """The same for links within an included file."""
    content[0] = content[0].replace("](docs/", "](")
    content[0] = re.sub(r"(!\[[^]]*\]\()benchmarks/", r"\1../benchmarks/", content[0])  # pictures
    content[0] = content[0].replace("](benchmarks/", "](path:../benchmarks/")
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
    """The values of a field, as pydantic describes it."""
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
    """Register them."""
    app.connect("source-read", _links_to_pages)
    app.connect("source-read", _fields_as_tables)
    app.connect("include-read", _includes)

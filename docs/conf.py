"""Settings of the documentation site: `make docs`."""

import re

from bilevel import __version__

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


def _includes(app: object, path: object, page: str, content: list[str]) -> None:
    """The same for links within an included file."""
    content[0] = content[0].replace("](docs/", "](")
    for file, target in _INCLUDED.items():
        content[0] = content[0].replace(f"]({file}", f"]({target}")


def setup(app):  # type: ignore[no-untyped-def]
    """Register the two."""
    app.connect("source-read", _links_to_pages)
    app.connect("include-read", _includes)

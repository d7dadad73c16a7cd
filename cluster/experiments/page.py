"""The report's page: one HTML file without any other, for a browser or a printer."""

import html
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from cluster.experiments.table import Row, html_table

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em;
  color: #1c1c1c; }
h1 { font-size: 1.6em; } h2 { font-size: 1.25em; margin-top: 2.2em; border-top: 1px solid #ccc;
  padding-top: .8em; } h3 { font-size: 1em; }
table { border-collapse: collapse; font-size: .82em; font-variant-numeric: tabular-nums; }
th, td { padding: .25em .6em; text-align: left; border-bottom: 1px solid #ddd;
  vertical-align: top; }
th { border-bottom: 2px solid #888; }
.wide { overflow-x: auto; } .pictures { display: flex; flex-wrap: wrap; gap: 1.5em; }
figure { margin: 1em 0; flex: 0 1 26em; } figure svg { width: 100%; height: auto; }
figcaption { font-size: .85em; color: #444; } code { background: #f3f3f3; padding: 0 .25em; }
details { margin: .6em 0; font-size: .9em; } .smoke { background: #fff3cd; padding: .6em 1em; }
@media print { body { max-width: none; } figure { break-inside: avoid; } }
"""


@dataclass(frozen=True)
class Picture:
    """A picture; `svg` is the content of a file that this package wrote."""

    name: str  # differs from those of all others on the page
    caption: str
    svg: str


@dataclass(frozen=True)
class Section:
    """An experiment on the page."""

    title: str
    explanation: str
    pictures: Sequence[Picture]
    summary: Sequence[Row]
    notes: Sequence[str]
    facts: Sequence[tuple[str, str]]  # settings, versions, command


def page(
    title: str, introduction: Sequence[str], compared: Sequence[Row], sections: Sequence[Section]
) -> str:
    """The whole page."""
    parts = [f"<h1>{html.escape(title)}</h1>", *map(_paragraph, introduction)]
    if compared:
        parts += [
            "<h2>The paper's figures and ours</h2>",
            f'<div class="wide">{html_table(compared)}</div>',
        ]
    parts += [part for section in sections for part in _section(section)]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f"<title>{html.escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )


def _section(section: Section) -> Iterable[str]:
    yield f"<h2>{html.escape(section.title)}</h2>"
    yield _paragraph(section.explanation)
    yield '<div class="pictures">'
    for picture in section.pictures:
        caption = html.escape(picture.caption)
        yield f"<figure>{inlined(picture)}<figcaption>{caption}</figcaption></figure>"
    yield "</div>"
    yield f'<div class="wide">{html_table(section.summary)}</div>'
    yield "<ul>" + "".join(f"<li>{html.escape(note)}</li>" for note in section.notes) + "</ul>"
    facts = "".join(
        f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
        for name, value in section.facts
    )
    yield f"<details><summary>settings, versions, command</summary><table>{facts}</table></details>"


def inlined(picture: Picture) -> str:
    """The picture without its XML head, its identifiers made unique on the page."""
    svg = picture.svg[picture.svg.index("<svg") :]
    own = re.sub(r"[^A-Za-z0-9]+", "-", picture.name)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{own}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{own}-\1)", svg)
    return re.sub(r'href="#([^"]+)"', rf'href="#{own}-\1"', svg)


def _paragraph(text: str) -> str:
    return f"<p>{html.escape(text)}</p>"

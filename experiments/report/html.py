"""Pieces of a page as HTML, and the page itself: one file that loads nothing."""

from __future__ import annotations

import json
import mimetypes
from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from plotly.offline import get_plotlyjs

Figure = dict[str, Any]
"""A plot: ``data`` and ``layout`` as plotly has them, or ``views``, each such with a ``label``, of which one
shows. A colour ``@name`` is the style sheet's ``--name``, ``@name/0.2`` the same let through."""

HERE = Path(__file__).parent
POLICY = (
    "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
)
"""What browsers let the page load: nothing that is not in it."""


class Section(NamedTuple):
    """A part of the page."""

    name: str  # in links
    title: str
    body: str  # HTML
    note: str = ""  # a sentence below the title, as text


def text(value: object) -> str:
    """A value as text in HTML."""
    return escape(str(value))


def plot(figure: Figure, height: int) -> str:
    """A plot, so many pixels high."""
    told = json.dumps(figure, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return (
        f'<figure class="plot" style="--height:{height}px"><div></div>'
        f'<script type="application/json">{told}</script></figure>'
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "") -> str:
    """A table of cells that are text already escaped; the first column is its rows' heads."""

    def line(cells: Sequence[str], tag: str) -> str:
        first, *others = cells
        return f'<tr><th scope="row">{first}</th>' + "".join(f"<{tag}>{c}</{tag}>" for c in others)

    body = "".join(line(row, "td") + "</tr>" for row in rows)
    return (
        f'<div class="wide"><table class="{kind}"><thead>{line(head, "th")}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """Names and values in columns."""
    return (
        '<dl class="facts">'
        + "".join(f"<div><dt>{text(k)}</dt><dd>{text(v)}</dd></div>" for k, v in pairs)
        + "</dl>"
    )


def folded(title: str, body: str) -> str:
    """What shows on a click."""
    return f"<details><summary>{text(title)}</summary>{body}</details>"


def missing(why: str) -> str:
    """In place of what is not there."""
    return f'<p class="missing">{text(why)}</p>'


def picture(file: Path, what: str, caption: str = "") -> str:
    """A picture inside the page; a file that is gone is said to be."""
    try:
        data = b64encode(file.read_bytes()).decode()
    except OSError:
        return missing(f"{file.name} is gone")
    kind = mimetypes.guess_type(file.name)[0] or "image/png"
    below = f"<figcaption>{caption}</figcaption>" if caption else ""
    return (
        f'<figure class="shot"><img src="data:{kind};base64,{data}" alt="{text(what)}">'
        f"{below}</figure>"
    )


def document(title: str, head: str, sections: Sequence[Section]) -> str:
    """The whole page.

    Args:
        title: of the window.
        head: HTML of what stands above all sections.
        sections: in their order.
    """
    links = "".join(f'<a href="#{s.name}">{text(s.title)}</a>' for s in sections)
    body = "".join(
        f'<section id="{s.name}"><h2>{text(s.title)}</h2>'
        + (f'<p class="note">{text(s.note)}</p>' if s.note else "")
        + f"{s.body}</section>"
        for s in sections
    )
    style, code = ((HERE / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{text(title)}</title>
<style>{style}</style></head><body>
<nav>{links}<button id="theme" type="button" aria-label="light or dark"></button></nav>
<main><header>{head}</header>{body}</main>
<noscript>The plots need JavaScript; all figures are in summary.json.</noscript>
<script>{get_plotlyjs()}</script>
<script>{code}</script>
</body></html>
"""

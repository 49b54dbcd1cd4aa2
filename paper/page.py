"""One HTML page of a Markdown report, pictures inside; it asks nothing of anybody."""

import re
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from paper.style import COLOURS, GROUND, INK, RULE

THEMED = {
    INK: "var(--ink)",
    RULE: "var(--rule)",
    GROUND: "var(--paper)",
    **{colour: f"var(--k{number})" for number, colour in enumerate(COLOURS)},
}
"""Colours of a drawing that follow the reader's choice of light or dark."""
VERDICTS = {
    "holds": "good", "holds in part": "fair", "does not hold": "bad", "not comparable": "soft",
}  # fmt: skip


def page(markdown: str, drawings: Mapping[str, str]) -> str:
    """Return a Markdown report as HTML.

    Parameters
    ----------
    markdown : str
        Begins with a heading, the page's title.
    drawings : mapping
        SVG text that takes the place of each picture of this address.
    """
    from markdown_it import MarkdownIt

    reader = MarkdownIt("commonmark", {"html": False}).enable("table")

    def picture(self: Any, tokens: Any, number: int, options: Any, env: Any) -> str:
        del self, options, env
        token = tokens[number]
        return _drawing(drawings[token.attrs["src"]], token.content)

    def table(self: Any, tokens: Any, number: int, options: Any, env: Any) -> str:
        del self, options, env
        head = [token.content for token in tokens[number : number + 24] if token.type == "inline"]
        name = ("claims" if "paper" in head else "bars") if "verdict" in head else "data"
        return f"<div class='scroll'><table class='{name}'>\n"

    reader.add_render_rule("image", picture)
    reader.add_render_rule("table_open", table)
    reader.add_render_rule("table_close", lambda *_: "</table></div>\n")
    body = reader.render(markdown)
    for verdict, tone in VERDICTS.items():
        body = body.replace(f"<td>{verdict}</td>", f"<td class='{tone}'>{verdict}</td>")
    body, contents = _linked(body)
    here = files("paper")
    return Template(here.joinpath("page.html").read_text("utf-8")).substitute(
        title=escape(markdown.partition("\n")[0].lstrip("# ")),
        style=here.joinpath("page.css").read_text("utf-8"),
        contents=contents,
        body=body,
    )


def _drawing(svg: str, title: str) -> str:
    """Return a drawing to stand in a page: named, in the page's colours."""
    drawing = svg[svg.index("<svg") :]
    for colour, themed in THEMED.items():
        drawing = re.sub(rf"{colour}\b", themed, drawing, flags=re.IGNORECASE)
    label = f"<svg role='img' aria-label='{escape(title)}'"
    return f"<span class='drawing'>{drawing.replace('<svg', label, 1).strip()}</span>"


def _linked(body: str) -> tuple[str, str]:
    """Return the body with numbered sections, and links to them."""
    titles = re.findall(r"<h2>(.*?)</h2>", body)
    for number, title in enumerate(titles):
        body = body.replace(f"<h2>{title}</h2>", f"<h2 id='s{number}'>{title}</h2>", 1)
    links = (f"<a href='#s{number}'>{title}</a>" for number, title in enumerate(titles))
    return body, "\n".join(links)

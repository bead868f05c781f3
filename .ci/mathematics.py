"""Mathematics of the pages as MathML, when the site is built.

Browsers draw MathML themselves, so a reader needs no script and no network; in the Markdown
files the formulas stay as they are.
"""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\[(\[](?P<tex>.*?)\\[)\]]</(?P=tag)>', re.S
)


def _mathml(found: re.Match[str]) -> str:
    display = "block" if found["tag"] == "div" else "inline"
    return convert(html.unescape(found["tex"]).strip(), display=display)


def on_page_content(content: str, **_: object) -> str:
    """Replace every formula of a page; mkdocs calls it."""
    return FORMULA.sub(_mathml, content)

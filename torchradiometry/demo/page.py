"""The page that the demo leaves behind: pictures, tables and plain words, in one folder.

Every file is first written into a temporary folder beside the target and moved into place
when the page is complete, so an interrupted demo leaves nothing half-written.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from urllib.parse import quote

from torchradiometry.places import check_folder_place, writing

__all__ = ["Figure", "Section", "Table", "staged_folder", "write_page"]

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.55 system-ui, sans-serif; max-width: 62rem; margin: auto; padding: 1rem; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2.5rem; }
figure { display: inline-block; margin: .5rem .8rem .5rem 0; vertical-align: top; }
figure img { display: block; max-width: 100%; min-width: 11rem; image-rendering: auto; }
figcaption { font-size: .85rem; opacity: .8; max-width: 22rem; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { padding: .3rem .9rem; border-bottom: 1px solid #8886; text-align: left; }
td + td, th + th { text-align: right; font-variant-numeric: tabular-nums; }
"""


@dataclass(frozen=True)
class Figure:
    """A picture file in the page's folder, with its caption."""

    file: str
    caption: str


@dataclass(frozen=True)
class Table:
    """Rows of text under a header."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Section:
    """One step of the demo: what was done, in words, pictures, figures."""

    title: str
    words: Sequence[str]
    figures: Sequence[Figure] = ()
    tables: Sequence[Table] = ()
    per_row: int = 4  #: figures side by side
    data: Mapping[str, object] = field(default_factory=dict)  #: for the JSON report


@contextmanager
def staged_folder(target: Path) -> Iterator[Path]:
    """A temporary folder whose files move to `target` when the block ends without an error.

    Files of `target` that the new page does not replace stay where they are.
    """
    check_folder_place(target, "page")
    with writing(target):
        stage = Path(tempfile.mkdtemp(prefix=".", suffix=".tmp", dir=target.absolute().parent))
    try:
        yield stage
        with writing(target):
            target.mkdir(exist_ok=True)
            for file in sorted(stage.iterdir()):
                file.replace(target / file.name)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def write_page(folder: Path, title: str, lead: str, sections: Sequence[Section]) -> Path:
    """Write `index.html` into `folder`, which already holds the pictures."""
    body = "\n".join(_section(section) for section in sections)
    page = folder / "index.html"
    text = (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n"
        f"<h1>{escape(title)}</h1>\n<p>{escape(lead)}</p>\n{body}\n</html>\n"
    )
    with writing(page):
        page.write_text(text, encoding="utf-8", errors="backslashreplace")
    return page


def _section(section: Section) -> str:
    parts = [f"<h2>{escape(section.title)}</h2>"]
    parts += [f"<p>{escape(words)}</p>" for words in section.words]
    for first in range(0, len(section.figures), section.per_row):
        row = section.figures[first : first + section.per_row]
        parts.append(f"<div>{''.join(_figure(figure) for figure in row)}</div>")
    parts += [_table(table) for table in section.tables]
    return "\n".join(parts)


def _figure(figure: Figure) -> str:
    caption, address = escape(figure.caption), quote(os.fsencode(figure.file))
    return (
        f'<figure><img src="{address}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
    )


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    rows = "\n".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows
    )
    return f"<table><tr>{head}</tr>\n{rows}</table>"

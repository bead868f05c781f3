"""Doctests of docstrings as Python code, when the site is built.

Markdown takes `>>>` for a quotation; here every doctest is put into a fence first.
"""

from __future__ import annotations

import re
import textwrap

import griffe

DOCTEST = re.compile(r"^( *)>>> .*(?:\n\1\S.*)*", re.M)


def _fenced(found: re.Match[str]) -> str:
    code = textwrap.dedent(found[0])
    return textwrap.indent(f"```pycon\n{code}\n```", found[1])


class Fences(griffe.Extension):
    """Puts fences around the doctests of every docstring; griffe calls it."""

    def on_instance(self, *, obj: griffe.Object, **_: object) -> None:
        if obj.docstring:
            obj.docstring.value = DOCTEST.sub(_fenced, obj.docstring.value)

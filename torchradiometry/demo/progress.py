"""Progress bars on standard error: one a long step, with what is left of the time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

__all__ = ["Advance", "progress_bar"]

#: called as advance(done, note): how many of the step's units are done, and a short word
Advance = Callable[[int, str], None]


@contextmanager
def progress_bar(title: str, total: int) -> Iterator[Advance]:
    """A bar for one step; the block calls the function it is given as work gets done.

    On a terminal the bar moves; elsewhere its last state is printed when the step ends.
    """
    columns = (
        TextColumn("{task.description:32s}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(file=sys.stderr)) as bar:
        task = bar.add_task(title, total=total, note="")

        def advance(done: int, note: str = "") -> None:
            bar.update(task, completed=done, note=note)

        yield advance

"""Progress bars on standard error: one a long step, with what is left of the time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column

__all__ = ["Advance", "progress_bar"]

#: called as advance(done, note): how many of the step's units are done, and a short word
Advance = Callable[[int, str], None]


@contextmanager
def progress_bar(*steps: tuple[str, int]) -> Iterator[list[Advance]]:
    """One bar for each (title, total); the block calls the functions it is given.

    On a terminal the bars move; elsewhere their last state is printed when the block ends.
    """
    columns = (
        TextColumn("{task.description:27s}"),
        BarColumn(bar_width=None),  # gives way where the line is short; numbers do not
        MofNCompleteColumn(table_column=Column(no_wrap=True, min_width=7)),
        TimeElapsedColumn(table_column=Column(no_wrap=True, min_width=7)),
        TimeRemainingColumn(table_column=Column(no_wrap=True, min_width=7)),
        TextColumn("{task.fields[note]}", markup=False),
    )
    with Progress(*columns, console=Console(file=sys.stderr)) as bars:
        tasks = [bars.add_task(title, total=total, note="", start=False) for title, total in steps]
        yield [partial(_advance, bars, task) for task in tasks]


def _advance(bars: Progress, task: TaskID, done: int, note: str = "") -> None:
    if done and not bars.tasks[task].started:
        bars.start_task(task)
    bars.update(task, completed=done, note=note)

"""Ctrl-C that no library can swallow.

Some libraries catch every exception while they look for optional ones (`except BaseException`
around an import), an interrupt too: it would be lost, and the command would run on. So an
interrupt that arrives during an import waits until the import is done.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["heard_interrupts"]

#: s between two looks whether the import is done
PAUSE = 0.05
IMPORTING = "<frozen importlib._bootstrap>"


@contextmanager
def heard_interrupts() -> Iterator[None]:
    """Within it, Ctrl-C ends what runs, during imports a little later.

    An interrupt that is ignored or handled by somebody else, and one in another thread than the
    first, is left as it is.
    """
    first = threading.current_thread() is threading.main_thread()
    if not first or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            later = threading.Timer(PAUSE, _thread.interrupt_main)
            later.daemon = True
            later.start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt

"""Peak memory of this process, as Linux counts it.

`VmHWM` in `/proc/self/status` is the largest resident size so far; writing 5 into
`/proc/self/clear_refs` sets it back to the present size. It costs microseconds and sees every
library. It holds what the allocator keeps for later as well, so that a small job after a large one
looks larger than alone. Other systems have no such counter: the peak is then None.

References: `proc(5)`, the manual of Linux's proc filesystem.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["peak_memory", "reset_peak_memory", "resident_memory"]

STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def reset_peak_memory() -> bool:
    """Forget the peak so far; False where the system does not let us."""
    try:
        CLEAR.write_text("5")
    except OSError:
        return False
    return True


def peak_memory() -> int | None:
    """Largest resident size since the last reset, bytes."""
    return _status("VmHWM")


def resident_memory() -> int | None:
    """Present resident size, bytes."""
    return _status("VmRSS")


def _status(key: str) -> int | None:
    try:
        lines = STATUS.read_text().splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith(f"{key}:")]
    return 1024 * int(found[0]) if found else None

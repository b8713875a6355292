"""Looking at processes that nobody may be there to bury."""

from __future__ import annotations

import os


def alive(pid: int) -> bool:
    """Whether a process still runs."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # Nobody may be there to bury it.
    with open(f"/proc/{pid}/stat") as stat:  # noqa: PTH123 - a pseudo file
        return stat.read().rpartition(")")[2].split()[0] != "Z"

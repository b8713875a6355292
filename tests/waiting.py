"""Waiting for what other threads and processes bring about, with patience: the host may have other things to do."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

PATIENCE_S: Final = 60.0


def eventually(holds: Callable[[], object], timeout_s: float = PATIENCE_S) -> bool:
    """Whether something holds in time."""
    until_s = time.monotonic() + timeout_s
    while not holds():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.005)
    return True


def wait_until(holds: Callable[[], object], timeout_s: float = PATIENCE_S) -> None:
    """Wait until something holds, which it must in time."""
    assert eventually(holds, timeout_s), f"it did not happen within {timeout_s:g} s"


def gone(pid: int) -> bool:
    """Whether a process has ended; one that nobody has waited for yet counts."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True

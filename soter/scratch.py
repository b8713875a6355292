"""Folders for what a run needs while it lasts. Those of runs that were killed are taken away by the next one."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
from pathlib import Path
from typing import Final

_PREFIX: Final = "soter-"
_LOCK: Final = ".lock"


class Scratch:
    """A folder of this user's only, below the system's folder for temporary files.

    It is held by a lock, which ends with this process however that ends; what nobody holds any more is removed when
    another one is made.

    Args:
        what: what it is for, a part of its name.

    Raises:
        OSError: it cannot be made.
    """

    def __init__(self, what: str) -> None:
        sweep()
        path, held = _made(what)
        while held is None:
            path, held = _made(what)
        self.path: Final = path
        self._lock = held

    def close(self) -> None:
        """Remove it, with all that is in it. Idempotent."""
        if self._lock >= 0:
            shutil.rmtree(self.path, ignore_errors=True)
            os.close(self._lock)
            self._lock = -1


def _made(what: str) -> tuple[Path, int | None]:
    path = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{what}-"))
    return path, _held(path / _LOCK, os.O_CREAT)


def sweep() -> None:
    """Remove the folders of processes that have ended without doing so."""
    for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError):
            status = path.lstat()
            if status.st_uid != os.geteuid() or not path.is_dir() or path.is_symlink():
                continue
            try:
                lock = _held(path / _LOCK)
            except FileNotFoundError:
                # A folder of another kind, or one that is being made.
                continue
            if lock is not None:
                shutil.rmtree(path, ignore_errors=True)
                os.close(lock)


def _held(path: Path, flags: int = 0) -> int | None:
    """Return what holds a lock, or None if another process holds it, or has just removed it."""
    lock = os.open(path, os.O_RDWR | os.O_NOFOLLOW | flags, 0o600)
    with contextlib.suppress(BlockingIOError):
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(lock).st_nlink:
            return lock
    os.close(lock)
    return None

"""What an untrusted process prints: passed on to the log, a little at a time."""

from __future__ import annotations

import logging
import os
import threading
import time
from typing import Final

logger = logging.getLogger(__name__)

_READ_BYTES: Final = 1 << 14
_PASSED_LINES: Final = 20
_PASSED_CHARACTERS: Final = 300
_PAUSE_S: Final = 0.1
_JOIN_S: Final = 0.5


class Words:
    """A pipe for a process's output, and a thread that logs what comes out of it.

    A process that prints without end is heard in part, and costs its reader a few wake-ups a second.

    Args:
        name: whose words.

    Attributes:
        output_fd: the pipe's end to write to; to be closed with `started` once the process has it.
    """

    def __init__(self, name: str) -> None:
        self._name: Final = name
        self._read_fd, self.output_fd = os.pipe()
        self._thread: Final = threading.Thread(target=self._pass_on, name=f"words of {name}", daemon=True)

    def started(self) -> None:
        """Listen: the process has its end of the pipe."""
        os.close(self.output_fd)
        self._thread.start()

    def close(self) -> None:
        """Wait for the last words of a process that has ended; not for those of one that it has left behind."""
        self._thread.join(_JOIN_S)

    def _pass_on(self) -> None:
        while data := os.read(self._read_fd, _READ_BYTES):
            lines = data.decode("utf-8", "replace").splitlines()
            for line in lines[:_PASSED_LINES]:
                if line.strip():
                    text = "".join(c if c.isprintable() else " " for c in line[:_PASSED_CHARACTERS])
                    logger.warning("%s: %s", self._name, text)
            if len(lines) > _PASSED_LINES:
                logger.warning("%s: ... and %d lines more", self._name, len(lines) - _PASSED_LINES)
            time.sleep(_PAUSE_S)
        os.close(self._read_fd)

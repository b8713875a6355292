"""Shows progress beside the ticks: a terminal that is slow, or that somebody has stopped, delays none of them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final, Self

from soter.runner.progress import Progress

logger = logging.getLogger(__name__)

_LAST_S: Final = 1.0
"""How long the end of a run waits for what is being shown."""


class Aside:
    """A thread that shows the latest progress there is. A context manager.

    Args:
        show: called in the thread; once it has failed it is not called again.
    """

    def __init__(self, show: Callable[[Progress], None]) -> None:
        self._show: Final = show
        self._latest: Progress | None = None
        self._wake: Final = threading.Event()
        self._done = False
        self._thread: Final = threading.Thread(target=self._run, name="progress", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done = True
        self._wake.set()
        self._thread.join(_LAST_S)

    def put(self, progress: Progress) -> None:
        """Have this shown, in place of what waits; returns at once."""
        self._latest = progress
        self._wake.set()

    def _run(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            latest, self._latest = self._latest, None
            if latest is not None:
                try:
                    self._show(latest)
                except Exception:
                    logger.exception("progress cannot be shown any more")
                    return
            if self._done:
                return

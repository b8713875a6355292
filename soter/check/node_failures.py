"""Collects supervisors' log messages about failed nodes, for trials in which nodes may fail a thousand times."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from soter.errors import account_of


class Collector(logging.Handler):
    """A log handler that keeps messages about failed nodes instead of printing them."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        failure = record.exc_info[1] if record.exc_info else None
        self.texts.append(f"{record.getMessage()}: {'' if failure is None else account_of(failure)}")


@contextmanager
def failures_of_nodes() -> Iterator[Sequence[str]]:
    """Collect the failures of nodes while the context lasts."""
    logger, collector = logging.getLogger("soter.rta.supervisor"), Collector()
    propagates, logger.propagate = logger.propagate, False
    logger.addHandler(collector)
    try:
        yield collector.texts
    finally:
        logger.removeHandler(collector)
        logger.propagate = propagates

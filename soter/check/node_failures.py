"""Collects what nodes fail with in trials, in which they may fail a thousand times."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from soter.errors import account_of, raised_at
from soter.rta import Node

_SOTER: Final = f"{Path(__file__).parents[1]}{os.sep}"


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


def told(failure: BaseException, node: Node) -> str:
    """Return a node's failure in words, with the file and line of the user's code, as far as there is one.

    What is wrong with what a node published is found outside it: then its `step` is named.
    """
    where, step = raised_at(failure), getattr(type(node).step, "__code__", None)
    if not where and step is not None and not step.co_filename.startswith(_SOTER):
        where = f" ({Path(step.co_filename).name}, line {step.co_firstlineno})"
    return account_of(failure) + where

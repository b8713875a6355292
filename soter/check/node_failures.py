"""Collects what nodes fail with in trials, in which they may fail a thousand times."""

from __future__ import annotations

import logging
import os
import sysconfig
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from soter.errors import account_of
from soter.rta import Node

_SOTER: Final = f"{Path(__file__).parents[1]}{os.sep}"
_LIBRARIES: Final = tuple({sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")})


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
    seen = [(each.filename, each.lineno) for each in traceback.extract_tb(failure.__traceback__)]
    step = getattr(type(node).step, "__code__", None)
    if step is not None:
        seen.insert(0, (step.co_filename, step.co_firstlineno))
    theirs = [place for place in seen if Path(place[0]).is_file() and not place[0].startswith(_SOTER)]
    own = [place for place in theirs if not place[0].startswith(_LIBRARIES)] or theirs
    where = f" ({Path(own[-1][0]).name}, line {own[-1][1]})" if own else ""
    return account_of(failure) + where

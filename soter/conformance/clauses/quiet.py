"""Quiet: standard output belongs to the program that uses an adapter, and the log to people who read it."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import tempfile
from collections.abc import Iterator
from typing import IO, Final, NamedTuple

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.conformance.figure import Failed
from soter.sdk import Controller, Robot

_TICKS: Final = 60
_LINES: Final = 10

_OUT, _ERR = 1, 2
_SHOWN: Final = 60


class _Log(logging.Handler):
    """Keeps what is logged as a warning or worse."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


class _Said(NamedTuple):
    """Lines of standard output, of standard error, and of the log."""

    out: list[str]
    err: list[str]
    log: list[str]


@clause("host.quiet")
def quiet(bench: Bench) -> None:
    """Standard output is left alone, and next to nothing logged, while a robot is driven, and while it is not heard."""
    robot = bench.open_one()
    _judge(bench, _said_by(bench, robot), "while it was driven")
    if bench.harness.gives("cut"):
        bench.faulty = True
        bench.harness.cut(robot.id)
        said = _said_by(bench, robot)
        bench.harness.restore(robot.id)
        _judge(bench, said, "while its link was cut")


def _said_by(bench: Bench, robot: Robot) -> _Said:
    """Drive a robot by a goal a tick, and return what was said meanwhile."""
    with _listening() as said:
        for number in range(_TICKS):
            robot.goto(bench.place(robot, 0.4 + 0.02 * (number % 10)), Controller.AC)
            bench.run(TICK_S)
    return said


def _judge(bench: Bench, said: _Said, when: str) -> None:
    if said.out:
        raise Failed(
            f"{when} it wrote {said.out[0][:_SHOWN]!r} to standard output: that belongs to the program that uses its "
            "robots, whose own output it garbles; say what there is to say by logging"
        )
    # What is logged may be written to standard error, too.
    lines = max(said.err, said.log, key=len)
    last = f", such as {lines[-1][:_SHOWN]!r}" if lines else ""
    bench.measure(
        "said_lines", len(lines), _LINES, 0.0,
        f"{when}, for {_TICKS} ticks, it said {len(lines)} lines{last}: at each tick or message, until nobody reads "
        "what is said, or the disk is full; say once what has begun, and once that it has ended",
    )  # fmt: skip


@contextlib.contextmanager
def _listening() -> Iterator[_Said]:
    """Keep what this process, and what it starts, writes and logs for a while."""
    said, log = _Said([], [], []), _Log()
    logging.root.addHandler(log)
    try:
        with _kept(_OUT, said.out), _kept(_ERR, said.err):
            yield said
    finally:
        logging.root.removeHandler(log)
        said.log.extend(log.lines)


@contextlib.contextmanager
def _kept(descriptor: int, lines: list[str]) -> Iterator[None]:
    """Keep what is written to a descriptor, and by Python in its name, as lines."""
    stream = sys.stdout if descriptor == _OUT else sys.stderr
    stream.flush()
    before = os.dup(descriptor)
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace", buffering=1) as file:
        os.dup2(file.fileno(), descriptor)
        try:
            with _redirected(descriptor, file):
                yield
        finally:
            os.dup2(before, descriptor)
            os.close(before)
            file.seek(0)
            lines.extend(file.read().splitlines())


def _redirected(descriptor: int, file: IO[str]) -> contextlib.AbstractContextManager[object]:
    return contextlib.redirect_stdout(file) if descriptor == _OUT else contextlib.redirect_stderr(file)

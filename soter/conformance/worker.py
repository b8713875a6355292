"""The process in which clauses are tried: a crash or a hang costs only the clause that was being tried."""

from __future__ import annotations

import contextlib
import faulthandler
import pickle
import signal
import socket
from types import FrameType
from typing import BinaryIO, Final

import msgspec

from soter.conformance.clause import CLAUSES
from soter.conformance.figure import Figure
from soter.conformance.find import find_harness, named
from soter.conformance.given import Given
from soter.conformance.kit import explain, try_clause
from soter.conformance.record import Outcome, Subject, Verdict, subject_of
from soter.conformance.usage import Usage, usage
from soter.conformance.wall_clock import take_over
from soter.errors import SoterError
from soter.isolation.child import MAX_MESSAGE_BYTES, die_with_parent

_LEFTOVERS: Final = 8
"""A process in which clauses leave more threads, descriptors or processes than this is not fit for the next one."""

_LONGEST_REASON: Final = MAX_MESSAGE_BYTES // 8


class Ready(msgspec.Struct, frozen=True, tag=True):
    """The harness is ready, or was refused.

    Attributes:
        name: the harness's name.
        side_by_side: whether several of its fleets may be open at once.
        a_core: how many clauses a core can try at once.
        on_wire: whether its robots run on the host's time, so that clauses mostly wait.
        clause_limit_s: how long a clause may take.
        starts_robots: whether the kit starts its robots.
        refusal: why there is no harness; empty if there is.
    """

    name: str = ""
    side_by_side: bool = False
    a_core: int = 1
    on_wire: bool = False
    clause_limit_s: float = 0.0
    starts_robots: bool = True
    refusal: str = ""


class Told(msgspec.Struct, frozen=True, tag=True):
    """The result of one clause, with the attributes of `Outcome` and two more.

    Attributes:
        subject: the adapter's robots.
        fit: whether another clause may be tried in this process.
    """

    clause: str
    verdict: Verdict
    reason: str
    figures: tuple[Figure, ...]
    host_s: float
    unready: bool
    subject: Subject | None
    fit: bool

    def outcome(self) -> Outcome:
        """Return the kit's outcome."""
        clause = CLAUSES[self.clause]
        return Outcome(clause, self.verdict, self.reason, self.figures, self.host_s, self.unready)


def decode(data: bytes) -> Ready | Told:
    """Return a worker's message."""
    return msgspec.msgpack.decode(data, type=Ready | Told)


class _Stopped(BaseException):
    """Raised to end the process, so that all that is open is closed on the way out."""


def main(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> None:
    """Try the clauses whose ids come through a socket, until it is closed; stdin names the harness."""
    die_with_parent(lifeline_fd)
    faulthandler.enable()
    take_over()
    target = pickle.load(stdin)  # noqa: S301 - from the parent
    link = socket.socket(fileno=socket_fd)
    signal.signal(signal.SIGTERM, _stop)
    with contextlib.suppress(_Stopped, BrokenPipeError, ConnectionResetError):
        _serve(link, target)


def _serve(link: socket.socket, target: str | Given) -> None:
    try:
        harness = find_harness(target)
    except Exception as failure:  # noqa: BLE001 - a harness of the user's own may fail in any way
        why = str(failure) if isinstance(failure, SoterError) else f"{named(target)}: {explain(failure)}"
        link.send(msgspec.msgpack.encode(Ready(refusal=why[:_LONGEST_REASON])))
        return
    ready = Ready(
        harness.name, harness.side_by_side, harness.a_core, harness.gives("cut"), harness.clause_limit_s,
        harness.starts_robots,
    )  # fmt: skip
    link.send(msgspec.msgpack.encode(ready))
    first: Usage | None = None
    while clause_id := link.recv(MAX_MESSAGE_BYTES).decode():
        outcome, bench = try_clause(CLAUSES[clause_id], harness)
        subject = subject_of(bench)
        del bench
        now = usage()
        first = first or now
        link.send(msgspec.msgpack.encode(Told(
            clause_id, outcome.verdict, outcome.reason[:_LONGEST_REASON], outcome.figures, outcome.host_s,
            outcome.unready, subject, not _left(first, now),
        )))  # fmt: skip


def _left(first: Usage | None, now: Usage | None) -> bool:
    if first is None or now is None:
        return False
    # Compared with the end of the first clause, when libraries have started the threads that they keep.
    counted = (first.threads, now.threads), (first.descriptors, now.descriptors), (first.processes, now.processes)
    return any(len(after) - len(before) > _LEFTOVERS for before, after in counted)


def _stop(_number: int, _frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise _Stopped

"""Tries clauses in processes of their own, one or several side by side, so that a crash does not end the kit.

A clause whose process crashes, exits or hangs fails, and the next one is tried in another process.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable
from typing import Final, Self

from soter.conformance.clause import Clause
from soter.conformance.find import named
from soter.conformance.given import Given
from soter.conformance.kit import CLOSE_LIMIT_S
from soter.conformance.record import Outcome, Record, Subject, Verdict
from soter.conformance.tally import Tally
from soter.conformance.worker import Ready, Told, decode
from soter.errors import BackendError
from soter.isolation.child import Child, ChildDied

_START_S: Final = 210.0
"""Time after which a process that is not ready for its first clause is killed."""

_MOST_JOBS: Final = 8
_LONGEST: Final = (
    "goto.accepted_is_not_reached", "endurance.minute", "several.second", "truth.capabilities.asked"
)  # fmt: skip
"""The longest clauses: tried early when clauses run side by side, since a late one would delay the end."""

_LOOK_S: Final = 0.05
_CLOSING_S: Final = 10.0
_LEAVING_S: Final = 2.0
_STDERR: Final = 2


class _Worker:
    """A process that tries one clause at a time, and is replaced by another once it is gone or unfit.

    Args:
        target: the harness, as `find_harness` takes it.
        stuck_s: how long a clause may take; None for its own limit and the time to close.
    """

    def __init__(self, target: str | Given, stuck_s: float | None) -> None:
        self._target: Final = target
        self._stuck_s: Final = stuck_s
        self._child: Child | None = None
        self._starting = False
        self._began_s = 0.0
        self.clause: Clause | None = None
        self.ready: Ready | None = None

    def begin(self, clause: Clause | None) -> None:
        """Begin with a clause; with None, only get ready."""
        self.clause, self._began_s = clause, time.monotonic()
        if self._child is None:
            self._child = Child(f"{__package__}.worker", self._target, output_fd=_STDERR)
            self._starting = True
        if clause is not None:
            # If the process is dead by now, `look` finds out.
            with contextlib.suppress(ChildDied):
                self._child.send(clause.id.encode())

    def look(self, patience_s: float) -> tuple[Outcome, Subject | None] | None:
        """Return the outcome of the clause and its subject, if there is one within `patience_s`."""
        assert self._child is not None
        try:
            data = self._child.receive(patience_s)
        except ChildDied as death:
            return self._lost(
                f"the process that tried it ended with {death}: the adapter, or a library that it uses, crashed or "
                "exited; what it said last, and the Python stack of a crash, is on standard error"
            )
        if data is None:
            limit_s = self._limit_s()
            if time.monotonic() - self._began_s <= limit_s:
                return None
            return self._lost(
                f"it had to be killed after {limit_s:g} s on the host: a call blocks outside of Python, or the "
                "adapter catches whatever is raised",
                stuck=True,
            )
        told = decode(data)
        if isinstance(told, Ready):
            # The start of the process does not count towards the clause's time.
            self.ready, self._starting, self._began_s = told, False, time.monotonic()
            return None
        return self._ended(told)

    def _limit_s(self) -> float:
        if self._starting or self.ready is None:
            return _START_S
        return self.ready.clause_limit_s + CLOSE_LIMIT_S if self._stuck_s is None else self._stuck_s

    def _ended(self, told: Told) -> tuple[Outcome, Subject | None]:
        self.clause = None
        if not told.fit:
            self.end()
        return told.outcome(), told.subject

    def _lost(self, reason: str, *, stuck: bool = False) -> tuple[Outcome, Subject | None] | None:
        clause, self.clause = self.clause, None
        self.end()
        if clause is None:
            self.ready = Ready(refusal=f"{named(self._target)}: {reason}")
            return None
        return Outcome(clause, Verdict.FAIL, reason, (), time.monotonic() - self._began_s, stuck), None

    def ask_to_end(self) -> None:
        """Let the process close all that it has open, if it is busy, and end."""
        if self._child is not None and self.clause is not None and self._child.how_it_ended() is None:
            os.kill(self._child.pid, signal.SIGTERM)

    def end(self, grace_s: float = 0.0) -> None:
        """End the process and all that it has started. Idempotent."""
        if self._child is not None:
            self._child.kill(grace_s)
            self._child = None


class Workshop:
    """Tries clauses on a harness in other processes. A context manager, which ends the processes.

    Args:
        target: a backend's name, a harness as `module:Harness`, both imported in those processes only, or a robot that
            the kit did not start.
        jobs: how many clauses are tried side by side, if the harness allows it; None for as many as the cores can.
        stop: polled; once it returns True, the robots are stopped and no more clauses are tried.
        stuck_s: time on the host after which a clause that cannot be interrupted is killed.

    Attributes:
        name: what the harness calls the adapter.
        jobs: how many clauses are tried side by side.
        given: whether the kit does not start the robots.

    Raises:
        BackendError: there is no such harness, or the harness cannot be used here.
    """

    def __init__(
        self,
        target: str | Given,
        jobs: int | None = 1,
        stop: Callable[[], bool] = lambda: False,
        stuck_s: float | None = None,
    ) -> None:
        self._stop: Final = stop
        self._workers: Final = [_Worker(target, stuck_s)]
        try:
            ready = self._get_ready(self._workers[0])
        except BaseException:
            self._workers[0].end()
            raise
        self.name: Final = ready.name or str(target)
        self.given: Final = not ready.starts_robots
        if jobs is None:
            jobs = min(ready.a_core * (os.cpu_count() or 1), _MOST_JOBS) if ready.on_wire else 1
        self.jobs: Final = jobs if ready.side_by_side else 1
        self._workers.extend(_Worker(target, stuck_s) for _ in range(self.jobs - 1))

    def _get_ready(self, worker: _Worker) -> Ready:
        worker.begin(None)
        while worker.ready is None and not self._stop():
            worker.look(_LOOK_S)
        ready = worker.ready or Ready()
        if ready.refusal:
            raise BackendError(ready.refusal)
        return ready

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.ask_to_end()
        # They close side by side: where all of them hang, that takes no longer than where one does.
        until_s = time.monotonic() + _CLOSING_S
        for worker in self._workers:
            worker.end(_LEAVING_S if worker.clause is None else max(0.0, until_s - time.monotonic()))

    def judge(
        self,
        clauses: Iterable[Clause],
        on_outcome: Callable[[Outcome, Record], None] | None = None,
        on_begin: Callable[[Collection[Clause]], None] | None = None,
    ) -> Record:
        """Try clauses; one that crashes or hangs does not stop the others. Return the record, of a stopped run as well.

        Args:
            clauses: the clauses to try.
            on_outcome: called with each outcome and the record so far.
            on_begin: called with the clauses being tried, when they change.
        """
        tally = Tally(self.name, clauses, on_outcome, given=self.given)
        waiting = deque(tally.clauses)
        if self.jobs > 1:
            # The first few show whether there are robots at all.
            first, rest = tally.clauses[: self.jobs], tally.clauses[self.jobs :]
            waiting = deque([*first, *sorted(rest, key=lambda each: each.id not in _LONGEST)])
        while not self._stop():
            if waiting and tally.hopeless():
                tally.give_up(waiting)
                waiting.clear()
            for worker in self._workers:
                if waiting and worker.clause is None:
                    worker.begin(waiting.popleft())
            busy = [worker for worker in self._workers if worker.clause is not None]
            if not busy:
                break
            if on_begin is not None:
                on_begin([worker.clause for worker in busy if worker.clause is not None])
            for worker in busy:
                came = worker.look(_LOOK_S / len(busy))
                if came is not None:
                    tally.add(*came)
        return tally.record()

"""A worker with a queue: which job it has, how long it may take, and what becomes of both when it fails."""

from __future__ import annotations

import math
import pickle
import time
from collections import deque
from dataclasses import dataclass, field

from soter.child import Child, ChildDied, NotBoxed
from soter.errors import ConfigError, SoterError
from soter.sandbox import Box
from soter.stack.planners.base import PlanRequest, PlanResult
from soter.stack.planners.names import PlannerUnavailable
from soter.stack.planners.wire import Garbage, decode_result, decode_start
from soter.stack.planners.worker import WorkerSpec

WORKER = "soter.stack.planners.worker"


@dataclass(slots=True, eq=False)
class Job:
    """A request on its way.

    Attributes:
        number: counts the requests of a service.
        request: the request.
        submitted_s: fleet time.
        result: None while there is none.
    """

    number: int
    request: PlanRequest
    submitted_s: float
    result: PlanResult | None = None

    @property
    def known(self) -> bool:
        """Whether there is a result."""
        return self.result is not None

    @property
    def due_s(self) -> float:
        """When the result is to be delivered, fleet time; infinite while there is none."""
        return math.inf if self.result is None else self.submitted_s + self.result.cost_s


@dataclass(slots=True)
class Limits:
    """How long workers may take, in seconds of host time, and what went wrong because of the host."""

    start_s: float
    answer_s: float
    incidents: list[str] = field(default_factory=list)


class Lane:
    """One worker, the jobs that wait for it, and what has to happen when it fails.

    One job is with the worker at a time; so it is clear which one it failed on, and nothing has to be sent again.
    """

    def __init__(self, spec: WorkerSpec, limits: Limits, box: Box | None = None) -> None:
        self._spec, self._limits, self._box = spec, limits, box
        self._waiting: deque[Job] = deque()
        self._busy: Job | None = None
        self._start()

    def _start(self) -> None:
        self._worker: Child | None = Child(WORKER, self._spec, box=self._box)
        self._ready = False
        self._since_s = time.perf_counter()

    @property
    def pid(self) -> int | None:
        """The worker's process id, or None while there is none."""
        return None if self._worker is None else self._worker.pid

    def add(self, job: Job) -> None:
        """Queue a job; its result will be set by a `step()`."""
        self._waiting.append(job)
        if self._worker is None:
            self._start()
        self._feed()

    def await_ready(self) -> None:
        """Wait for the worker's first message; a failure to start is an error here, not a failed plan."""
        while not self._ready:
            if self._worker is None:
                self._start()
            assert self._worker is not None
            name = self._spec.planner
            try:
                message = self._receive(wait=True)
                if message is None:
                    limit = f"{self._limits.start_s:g} s"
                    raise PlannerUnavailable(f"planner '{name}' did not start within {limit}; is the host overloaded?")
                self._begin(message)
            except NotBoxed as error:
                self.close()
                raise PlannerUnavailable(
                    f"planner '{name}' cannot be boxed in, as isolation.sandbox requires: {error}"
                ) from error
            except (ChildDied, Garbage) as error:
                self.close()
                raise PlannerUnavailable(f"planner '{name}' could not be started ({error})") from error
            except SoterError:
                self.close()
                raise

    def step(self, *, wait: bool) -> None:
        """Take one message from the worker, or find out that none will come in time."""
        if self._worker is None:
            if not self._waiting:
                return
            self._start()
        try:
            message = self._receive(wait=wait)
            if message is not None:
                self._take(message)
                return
        except ChildDied as error:
            self._lose(f"the worker died ({error})")
            return
        except Garbage as error:
            self._lose(f"garbage: {error}")
            return
        except SoterError as error:
            self._lose(f"the worker could not be restarted ({error})")
            return
        limit_s = self._limits.answer_s if self._ready else self._limits.start_s
        if (self._busy or not self._ready) and time.perf_counter() - self._since_s >= limit_s:
            did_not = "answer" if self._ready else "start"
            self._lose(f"the planner did not {did_not} within {limit_s:g} s of host time")

    def close(self) -> None:
        """Kill the worker. Idempotent."""
        if self._worker is not None:
            self._worker.kill()
            self._worker = None
        self._ready = False

    def _receive(self, *, wait: bool) -> bytes | None:
        assert self._worker is not None
        if not wait:
            return self._worker.receive(0.0)
        limit_s = self._limits.answer_s if self._ready else self._limits.start_s
        return self._worker.receive(max(self._since_s + limit_s - time.perf_counter(), 0.0))

    def _take(self, message: bytes) -> None:
        if not self._ready:
            self._begin(message)
        elif self._busy is None:
            raise Garbage("a message that nobody asked for")
        else:
            job = self._busy
            job.result = decode_result(job.number, job.request.request_id, message)
            self._busy = None
        self._feed()

    def _begin(self, message: bytes) -> None:
        start = decode_start(message)
        if start.kind == "config":
            error = ConfigError(start.message)  # which has its place in it already
            error.source, error.line, error.key = start.source, start.line, start.key
            raise error
        if start.kind == "unavailable":
            raise PlannerUnavailable(start.message)
        self._ready = True

    def _feed(self) -> None:
        if not self._ready or self._busy is not None or not self._waiting:
            return
        assert self._worker is not None
        job = self._waiting[0]
        try:
            sent = self._worker.send(pickle.dumps((job.number, job.request)))
        except ChildDied:
            sent = False
        if not sent:
            # It died while it had nothing to do: no plan is lost.
            self.close()
            self._start()
            return
        self._busy = self._waiting.popleft()
        self._since_s = time.perf_counter()

    def _lose(self, reason: str) -> None:
        """Give up the worker and the job that it had, or that it was started for."""
        was_ready = self._ready
        self.close()
        job, self._busy = self._busy, None
        if job is None and self._waiting:
            job = self._waiting.popleft()
        if job is not None:
            job.result = PlanResult.failed(job.request.request_id, reason)
            self._limits.incidents.append(f"request {job.request.request_id}: {reason}")
        # A worker that does not even start is only tried again when there is a plan to make.
        if was_ready or self._waiting:
            self._start()

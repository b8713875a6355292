"""Runs untrusted planners in worker processes, and delivers their plans in virtual time."""

from __future__ import annotations

import math
import pickle
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Final, Self

from soter.errors import ConfigError, Garbage, SoterError
from soter.isolation.child import Child, ChildDied, NotBoxed
from soter.isolation.sandbox import SandboxRules
from soter.stack.planners.base import CHECK_COST_S, Planner, PlanRequest, PlanResult
from soter.stack.planners.names import TRUSTED, PlannerSpec, PlannerUnavailable, check_name
from soter.stack.planners.worker import WorkerSpec, checked, decode_result, decode_start, garbage

WORKER = "soter.stack.planners.worker"


@dataclass(slots=True, eq=False)
class PlanJob:
    """A pending request, and the fleet time of its submission; jobs of a service are numbered."""

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
        """Fleet time at which the result is to be delivered; infinite while there is none."""
        return math.inf if self.result is None else self.submitted_s + self.result.cost_s


@dataclass(slots=True)
class HostLimits:
    """Time limits of workers, in seconds of host time, and the incidents that the host caused."""

    start_s: float
    answer_s: float
    incidents: list[str] = field(default_factory=list)


class Lane:
    """One worker and the jobs that wait for it; replaces the worker when it fails.

    The worker has one job at a time: so it is clear which job it failed on, and no other has to be sent again.
    """

    def __init__(self, spec: WorkerSpec, limits: HostLimits, box: SandboxRules | None = None) -> None:
        self._spec, self._limits, self._box = spec, limits, box
        self._waiting: deque[PlanJob] = deque()
        self._busy: PlanJob | None = None
        self._start()

    def _start(self) -> None:
        self._worker: Child | None = Child(WORKER, self._spec, box=self._box)
        self._ready = False
        self._since_s = time.perf_counter()

    @property
    def pid(self) -> int | None:
        """The worker's process id, or None while there is none."""
        return None if self._worker is None else self._worker.pid

    def add(self, job: PlanJob) -> None:
        """Queue a job; its result will be set by a `step()`."""
        self._waiting.append(job)
        if self._worker is None:
            self._start()
        self._feed()

    def await_ready(self) -> None:
        """Wait until the worker is ready; raise if it cannot start."""
        while not self._ready:
            if self._worker is None:
                self._start()
            assert self._worker is not None
            name = self._spec.planner.name
            try:
                message = self._receive(wait=True)
                if message is None:
                    limit = f"{self._limits.start_s:g} s"
                    raise PlannerUnavailable(f"planner '{name}' did not start within {limit}; is the host overloaded?")
                self._begin(message)
            except NotBoxed as error:
                self.close()
                raise PlannerUnavailable(
                    f"planner '{name}' cannot be sandboxed, as isolation.sandbox requires: {error}"
                ) from error
            except (ChildDied, Garbage) as error:
                self.close()
                raise PlannerUnavailable(f"planner '{name}' could not be started ({error})") from error
            except SoterError:
                self.close()
                raise

    def step(self, *, wait: bool) -> None:
        """Take one message from the worker, or give the worker up if none comes in time."""
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
            raise Garbage("an answer without a request")
        else:
            job = self._busy
            job.result = decode_result(job.number, job.request.request_id, message)
            self._busy = None
        self._feed()

    def _begin(self, message: bytes) -> None:
        refused = decode_start(message)
        if refused is not None:
            error = refused.error()
            raise error if isinstance(error, ConfigError) else PlannerUnavailable(str(error))
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
            # The worker died while idle: no plan is lost.
            self.close()
            self._start()
            return
        self._busy = self._waiting.popleft()
        self._since_s = time.perf_counter()

    def _lose(self, reason: str) -> None:
        """Give up the worker, and fail the job that it had or was started for."""
        was_ready = self._ready
        self.close()
        job, self._busy = self._busy, None
        if job is None and self._waiting:
            job = self._waiting.popleft()
        if job is not None:
            job.result = PlanResult.failed(job.request.request_id, reason)
            self._limits.incidents.append(f"request {job.request.request_id}: {reason}")
        # A worker that could not even start is restarted only when there is a plan to make.
        if was_ready or self._waiting:
            self._start()


TIME_LIMIT_S = 10.0
"""Host time in seconds after which a planner that has not answered is killed."""

START_LIMIT_S = 60.0
"""Host time in seconds after which a worker that is not ready is killed."""

MEMORY_LIMIT_BYTES = 2 << 30
"""Address space that a planner may use beyond the bare worker's, in bytes."""

WALL_CLOCK_NICENESS = 5


class PlanService:
    """Runs an untrusted planner in a worker process and delivers its plans at the right time.

    In virtual time a plan is delivered at its request's time plus its cost (state checks), however long the host
    took to compute it, so that a run repeats itself. A planner's misbehaviour costs its robot a plan and nothing else:
    exceptions, garbage, silence beyond the time limit and the death of a worker become failed results.

    Trusted planners (`straight-line`) run in the caller's process; their results are the same either way.

    Not thread-safe: it belongs to the mission's thread. A context manager.

    Args:
        planner: the planner, and what it is built for.
        virtual_time: False for a mission on a wall clock, where results are delivered as they come and nothing waits.
        in_process: False to run a trusted planner in a worker, too.
        time_limit_s: host time after which a worker that does not answer is killed, in seconds.
        start_limit_s: host time that a worker may take to start, in seconds.
        memory_limit_bytes: address space that a planner may use, beyond the bare worker's.
        box: the worker's sandbox, or None for no sandbox.

    Raises:
        ConfigError: the planner's name, or an option of a trusted planner, is wrong. Options of other planners are
            checked by the worker, and `ready()` raises.
    """

    def __init__(
        self,
        planner: PlannerSpec,
        *,
        virtual_time: bool = True,
        in_process: bool = True,
        time_limit_s: float = TIME_LIMIT_S,
        start_limit_s: float = START_LIMIT_S,
        memory_limit_bytes: int = MEMORY_LIMIT_BYTES,
        box: SandboxRules | None = None,
    ) -> None:
        check_name(planner.name)
        self._virtual_time: Final = virtual_time
        self._limits: Final = HostLimits(start_limit_s, time_limit_s)
        self._pending: list[PlanJob] = []
        self._submitted = 0
        self._closed = False
        self._lane: Lane | None = None
        self._local: Planner | None = None
        if in_process and planner.name in TRUSTED:
            self._local = planner.build()
            return
        # A runaway planner must not starve the supervisors on the same host; in virtual time everything waits for it.
        niceness = 0 if virtual_time else WALL_CLOCK_NICENESS
        self._lane = Lane(WorkerSpec(planner, memory_limit_bytes, niceness), self._limits, box)

    @property
    def incidents(self) -> tuple[str, ...]:
        """The incidents that made the run non-deterministic, one line each, oldest first."""
        return tuple(self._limits.incidents)

    @property
    def pids(self) -> tuple[int, ...]:
        """Process id of the worker, if one is running now."""
        return () if self._lane is None or self._lane.pid is None else (self._lane.pid,)

    def ready(self) -> None:
        """Wait until the worker, which has been starting since the construction, is ready.

        Call it before anything moves: it raises for a bad option of an untrusted planner.

        Raises:
            ConfigError: there is no such planner, or an option is wrong.
            PlannerUnavailable: a library is missing, or the worker cannot be started.
        """
        try:
            if self._lane is not None:
                self._lane.await_ready()
        except BaseException:
            self.close()
            raise

    def submit(self, request: PlanRequest, now_s: float) -> None:
        """Hand in a request and return at once.

        Args:
            request: the request; its id must differ from those of all pending requests.
            now_s: fleet time.

        Raises:
            ValueError: a request with that id is pending.
            RuntimeError: the service is closed.
        """
        if self._closed:
            raise RuntimeError("the plan service is closed")
        if any(job.request.request_id == request.request_id for job in self._pending):
            raise ValueError(f"request {request.request_id} is pending already")
        job = PlanJob(self._submitted, request, now_s)
        self._submitted += 1
        self._pending.append(job)
        if self._local is not None:
            try:
                job.result = checked(request.request_id, self._local.plan(request))
            except Garbage as error:
                job.result = garbage(request.request_id, error)
        elif self._lane is not None:
            self._lane.add(job)

    def due(self, now_s: float) -> list[PlanResult]:
        """Return the results that are due, earliest first, then in the order of their requests.

        In virtual time this waits for a worker if, and only as long as, a pending result might be due by now.
        """
        if not self._pending:
            return []
        lane = self._lane
        for job in self._pending:
            if job.known or lane is None:
                continue
            lane.step(wait=False)
            if self._virtual_time and job.submitted_s + CHECK_COST_S <= now_s:
                while not job.known:
                    lane.step(wait=True)
        if self._virtual_time:
            done = [job for job in self._pending if job.due_s <= now_s]
            done.sort(key=lambda job: (job.due_s, job.number))
        else:
            done = [job for job in self._pending if job.known]
        if not done:
            return []
        self._pending = [job for job in self._pending if job not in done]
        return [job.result for job in done if job.result is not None]

    def close(self) -> None:
        """Kill the worker and wait until it is gone. Pending results are lost. Idempotent."""
        self._closed = True
        self._pending.clear()
        if self._lane is not None:
            self._lane.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

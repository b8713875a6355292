"""Plans on request, delivered in virtual time, from planners that are not trusted with anything."""

from __future__ import annotations

import pickle
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Final, Self

from soter.errors import ConfigError, SoterError
from soter.stack.planners.base import CHECK_COST_S, Planner, PlanRequest, PlanResult
from soter.stack.planners.names import TRUSTED, PlannerUnavailable, build_planner, check_name
from soter.stack.planners.process import WorkerDied, WorkerProcess
from soter.stack.planners.wire import Garbage, checked, decode_result, decode_start, garbage
from soter.stack.planners.worker import WorkerSpec
from soter.workspace import Workspace

TIME_LIMIT_S = 10.0
"""A planner that has not answered after so much host time is killed, in seconds."""

START_LIMIT_S = 60.0
"""A worker that is not ready after so much host time is killed, in seconds."""

MEMORY_LIMIT_BYTES = 2 << 30


@dataclass(frozen=True, slots=True)
class Ticket:
    """The promise of one result.

    Attributes:
        request_id: the request.
        submitted_s: fleet time at which it was handed in.
    """

    request_id: int
    submitted_s: float


@dataclass(slots=True, eq=False)
class _Job:
    number: int
    request: PlanRequest
    submitted_s: float
    result: PlanResult | None = None

    @property
    def due_s(self) -> float:
        assert self.result is not None
        return self.submitted_s + self.result.cost_s


@dataclass(slots=True)
class _Limits:
    start_s: float
    answer_s: float
    incidents: list[str] = field(default_factory=list)


class _Lane:
    """One worker, the jobs that wait for it, and what has to happen when it fails.

    One job is with the worker at a time; so it is clear which one it failed on, and nothing has to be sent again.
    """

    def __init__(self, spec: WorkerSpec, limits: _Limits) -> None:
        self._spec, self._limits = spec, limits
        self._waiting: deque[_Job] = deque()
        self._busy: _Job | None = None
        self._start()

    def _start(self) -> None:
        self._worker: WorkerProcess | None = WorkerProcess(self._spec)
        self._ready = False
        self._since_s = time.perf_counter()

    def add(self, job: _Job) -> None:
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
            except (WorkerDied, Garbage) as error:
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
        except WorkerDied as error:
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
        kind, text, key = decode_start(message)
        if kind == "config":
            raise ConfigError(text, key=key)
        if kind == "unavailable":
            raise PlannerUnavailable(text)
        self._ready = True

    def _feed(self) -> None:
        if not self._ready or self._busy is not None or not self._waiting:
            return
        assert self._worker is not None
        job = self._waiting[0]
        try:
            self._worker.send(pickle.dumps((job.number, job.request)))
        except WorkerDied:
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


class PlanService:
    """Runs an untrusted planner in worker processes and hands out its plans at the right time.

    In virtual time a plan is delivered at its request's time plus its cost (state checks), however long the host
    took to compute it, so that a run repeats itself. Whatever the planner does costs its robot a plan and nothing
    else: exceptions, garbage, silence beyond the time limit and the death of a worker become failed results.

    Trusted planners (`straight-line`) run in the caller's process; their results are the same either way.

    Not thread-safe: it belongs to the mission's thread. A context manager.

    Args:
        planner: a built-in name, or `module:Class`.
        workspace: the known fence and boxes.
        body_radius_m: radius of the robots' round bodies, in metres.
        options: the raw table `[planners.NAME]`.
        workers: number of worker processes. Requests go to them in turn, so that it makes no difference which one
            is quicker.
        virtual_time: False for a mission on a wall clock: results are handed out as they come and nothing waits.
        in_process: False to have a worker for a trusted planner, too.
        time_limit_s: host time after which a worker that does not answer is killed, in seconds.
        start_limit_s: host time that a worker may take to start, in seconds.
        memory_limit_bytes: address space that a planner may use, beyond the bare worker's.

    Raises:
        ConfigError: the planner's name, or the options of a trusted planner, are wrong. For other planners the
            worker finds out, and `ready()` raises.
    """

    def __init__(
        self,
        planner: str,
        workspace: Workspace,
        body_radius_m: float,
        options: Mapping[str, Any] | None = None,
        *,
        workers: int = 1,
        virtual_time: bool = True,
        in_process: bool = True,
        time_limit_s: float = TIME_LIMIT_S,
        start_limit_s: float = START_LIMIT_S,
        memory_limit_bytes: int = MEMORY_LIMIT_BYTES,
    ) -> None:
        if workers < 1:
            raise ValueError(f"workers is {workers}, must be at least 1")
        check_name(planner)
        self._virtual_time: Final = virtual_time
        self._limits: Final = _Limits(start_limit_s, time_limit_s)
        self._pending: list[_Job] = []
        self._submitted = 0
        self._closed = False
        self._lanes: list[_Lane] = []
        self._local: Planner | None = None
        if in_process and planner in TRUSTED:
            self._local = build_planner(planner, workspace, body_radius_m, options)
            return
        spec = WorkerSpec(planner, workspace, body_radius_m, dict(options or {}), memory_limit_bytes)
        self._lanes += [_Lane(spec, self._limits) for _ in range(workers)]

    @property
    def deterministic(self) -> bool:
        """False once a result depended on the host: a worker was too slow, or died."""
        return not self._limits.incidents

    @property
    def incidents(self) -> tuple[str, ...]:
        """What made the run non-deterministic, one line each, oldest first."""
        return tuple(self._limits.incidents)

    @property
    def pending(self) -> int:
        """Number of results that are yet to be delivered."""
        return len(self._pending)

    def ready(self) -> None:
        """Wait until the workers are ready, which they get by themselves since the construction. Call it before
        anything moves: it is where a bad option of an untrusted planner shows.

        Raises:
            ConfigError: there is no such planner, or an option is wrong.
            PlannerUnavailable: a library is missing, or the worker cannot be started.
        """
        try:
            for lane in self._lanes:
                lane.await_ready()
        except BaseException:
            self.close()
            raise

    def submit(self, request: PlanRequest, now_s: float) -> Ticket:
        """Hand in a request and return at once.

        Args:
            request: the request; its id must differ from those of all that are pending.
            now_s: fleet time.

        Raises:
            ValueError: a request with that id is pending.
            RuntimeError: the service is closed.
        """
        if self._closed:
            raise RuntimeError("the plan service is closed")
        if any(job.request.request_id == request.request_id for job in self._pending):
            raise ValueError(f"request {request.request_id} is pending already")
        job = _Job(self._submitted, request, now_s)
        self._submitted += 1
        self._pending.append(job)
        if self._local is not None:
            try:
                job.result = checked(request.request_id, self._local.plan(request))
            except Garbage as error:
                job.result = garbage(request.request_id, error)
        else:
            self._lanes[job.number % len(self._lanes)].add(job)
        return Ticket(request.request_id, now_s)

    def due(self, now_s: float) -> list[PlanResult]:
        """Return the results whose time has come, earliest first, then in the order of their requests.

        In virtual time this waits for a worker if, and only as long as, a pending result might be due by now.

        Args:
            now_s: fleet time.
        """
        if not self._pending:
            return []
        for job in self._pending:
            if job.result is None and self._lanes:
                lane = self._lanes[job.number % len(self._lanes)]
                lane.step(wait=False)
                while self._virtual_time and job.result is None and job.submitted_s + CHECK_COST_S <= now_s:
                    lane.step(wait=True)
        done = [job for job in self._pending if job.result is not None]
        if self._virtual_time:
            done = sorted((job for job in done if job.due_s <= now_s), key=lambda job: (job.due_s, job.number))
        if not done:
            return []
        self._pending = [job for job in self._pending if job not in done]
        return [job.result for job in done if job.result is not None]

    def close(self) -> None:
        """Kill the workers and wait until they are gone. Pending results are lost. Idempotent."""
        self._closed = True
        self._pending.clear()
        for lane in self._lanes:
            lane.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

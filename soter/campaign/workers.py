"""Processes of this host that carry out runs, each one run at a time."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Final, Protocol, Self

from soter.campaign.job import Done, Job, begin, work


class Workers(Protocol):
    """Carries out runs in other processes. A context manager, which ends these.

    Attributes:
        count: how many runs to submit at a time.
        died: the exception that a future raises when its worker has died.
    """

    count: int
    died: tuple[type[BaseException], ...]

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def submit(self, job: Job) -> Future[Done]:
        """Begin a run."""


class LocalWorkers:
    """Worker processes of this host; `Workers`.

    Every worker is a pool of its own, so that a process that dies shows which run it died of, and takes no other along.
    """

    died: tuple[type[BaseException], ...] = (BrokenProcessPool,)

    def __init__(self, count: int) -> None:
        self.count = count
        # Not fork, since numeric libraries have threads.
        self._context: Final = multiprocessing.get_context("spawn")
        self._stop: Final = self._context.Event()
        self._pools: list[ProcessPoolExecutor] = []
        self._running: list[Future[Done] | None] = [None] * count

    def __enter__(self) -> Self:
        self._pools = [self._pool() for _ in range(self.count)]
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for pool in self._pools:
            pool.shutdown(cancel_futures=True)

    def submit(self, job: Job) -> Future[Done]:
        at = next(at for at, running in enumerate(self._running) if running is None or running.done())
        try:
            future = self._pools[at].submit(work, job)
        except BrokenProcessPool:
            self._pools[at].shutdown()
            self._pools[at] = self._pool()
            future = self._pools[at].submit(work, job)
        self._running[at] = future
        return future

    def _pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, self._context, begin, (self._stop,))

"""Runs cases, each in a process of its own, as whoever reads the evaluation would."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from threading import Event, Lock
from typing import Final

from pydantic import ValidationError

from soter.runner import RunResult
from tools.acceptance.cases import Case
from tools.acceptance.store import ROOT, Store, source_hash

GRACE_S: Final = 20.0
"""What a run gets to stop its robots in, when it is told to."""

_POLL_S: Final = 0.1


class CaseFailed(Exception):
    """A run left no result that counts; the text says why."""


class CaseStopped(Exception):
    """A run was ended because the whole evaluation was."""


@contextlib.contextmanager
def busy_machine(processes: int) -> Iterator[None]:
    """Keep so many processes computing; they end with this one, however it ends."""
    command = [sys.executable, "-c", "import os\nparent = os.getppid()\nwhile os.getppid() == parent: pass"]
    running = [subprocess.Popen(command, start_new_session=True) for _ in range(processes)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
        for process in running:
            process.wait()


def run_case(case: Case, scale: float, stop: Event) -> RunResult:
    """Run one case to its end.

    Raises:
        CaseFailed: no result was written, or the run did not get to its end.
        CaseStopped: `stop` was set.
    """
    load = 2 * (os.cpu_count() or 1) if case.loaded else 0
    with busy_machine(load), tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "result.json"
        errors = Path(folder) / "errors"
        command = [sys.executable, "-m", "soter.cli", *case.arguments(scale)]
        command += ["--quiet", "--no-record", "--json", str(written)]
        with errors.open("w") as stderr:
            # In a session of its own: Ctrl-C reaches this process only, which then ends the runs in order.
            process = subprocess.Popen(
                command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=stderr, stderr=stderr, start_new_session=True
            )
            try:
                while process.poll() is None:
                    if stop.wait(_POLL_S):
                        raise CaseStopped(case.name)
            finally:
                _end(process)
        said = errors.read_text()[-2000:].strip()
        try:
            result = RunResult.model_validate_json(written.read_bytes())
        except (OSError, ValidationError) as failure:
            raise CaseFailed(f"exit code {process.returncode}, no result: {said}") from failure
    if result.status != "completed":
        raise CaseFailed(f"the run {result.status}: {result.failure or said}")
    return result


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is not None:
        return
    process.send_signal(signal.SIGINT)
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Session:
    """Runs what is missing in a store.

    Args:
        store: where results go.
        on_change: called, in any thread, with a case and what became of it: "started", "finished", or why not.
    """

    def __init__(self, store: Store, on_change: Callable[[Case, str], None]) -> None:
        self.failures: dict[str, str] = {}
        self._store: Final = store
        self._on_change: Final = on_change
        self._stop: Final = Event()
        self._lock: Final = Lock()

    def run(self, cases: Sequence[Case], jobs: int) -> None:
        """Run the cases, at most so many at a time.

        Raises:
            KeyboardInterrupt: after the runs under way were ended; finished ones are stored.
        """
        with ThreadPoolExecutor(jobs) as pool:
            waiting: set[Future[None]] = {pool.submit(self._one, case) for case in cases}
            try:
                while waiting:
                    done, waiting = wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED)
                    for future in done:
                        future.result()
            finally:
                self._stop.set()

    def _one(self, case: Case) -> None:
        if self._stop.is_set():
            return
        self._on_change(case, "started")
        started_s = time.monotonic()
        try:
            result = run_case(case, self._store.scale, self._stop)
            if source_hash() != self._store.source:
                raise CaseFailed("the sources have changed since the evaluation began; start it again")
            self._store.save(case, result)
        except CaseStopped:
            return
        except CaseFailed as failure:
            with self._lock:
                self.failures[case.name] = str(failure)
            self._on_change(case, f"failed: {failure}")
        else:
            self._on_change(case, f"finished in {time.monotonic() - started_s:.0f} s")

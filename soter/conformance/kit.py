"""Judges an adapter: every clause on a bench of its own, whatever the others did."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Final

import soter.conformance.clauses  # noqa: F401 - registers the clauses
from soter.conformance.bench import Bench, Failed, NotTested
from soter.conformance.clause import CLAUSES, Clause, Tier
from soter.conformance.harness import Harness
from soter.conformance.record import Outcome, Record, Verdict, make_record, subject_of
from soter.errors import ConfigError, nearest

HOST_LIMIT_S: Final = 180.0
"""A clause that takes longer than this on the host hangs, and fails."""


def select(only: Sequence[str] = ()) -> list[Clause]:
    """Return the clauses of these ids, or of these groups; all of them if none is named.

    Raises:
        ConfigError: there is no such clause.
    """
    wanted: list[Clause] = []
    for name in only:
        found = [each for key, each in CLAUSES.items() if key == name or key.startswith(f"{name}.")]
        if not found:
            raise ConfigError(f"there is no clause '{name}'{nearest(name, list(CLAUSES))}", key="--only")
        wanted += [each for each in found if each not in wanted]
    return wanted if only else list(CLAUSES.values())


def judge(
    harness: Harness,
    clauses: Sequence[Clause] | None = None,
    on_outcome: Callable[[Outcome], None] | None = None,
    on_clause: Callable[[Clause], None] | None = None,
) -> Record:
    """Try clauses on an adapter, one after another; none stops the others.

    Args:
        harness: of the adapter.
        clauses: which; None for all.
        on_outcome: told of each outcome as it comes.
        on_clause: told of each clause before it is tried.
    """
    chosen = list(CLAUSES.values()) if clauses is None else list(clauses)
    outcomes: list[Outcome] = []
    subject = None
    for each in chosen:
        if on_clause is not None:
            on_clause(each)
        outcome, bench = try_clause(each, harness)
        subject = subject or subject_of(bench)
        outcomes.append(outcome)
        if on_outcome is not None:
            on_outcome(outcome)
    return make_record(harness.name, subject, outcomes, complete=len(chosen) == len(CLAUSES))


def try_clause(clause: Clause, harness: Harness) -> tuple[Outcome, Bench]:
    """Try one clause on a bench of its own; return what came out, and the bench, closed."""
    bench = Bench(harness, truth=clause.tier is Tier.TRUTH, needs=clause.needs)
    began_s = time.perf_counter()
    missing = [hook for hook in clause.hooks if not harness.gives(hook)]
    if missing:
        reason = f"hook{'s' if len(missing) > 1 else ''} not given: {', '.join(missing)}"
        return Outcome(clause, Verdict.NOT_TESTED, reason, (), 0.0), bench
    verdict, reason = Verdict.PASS, ""
    try:
        with _host_limit(HOST_LIMIT_S):
            clause.check(bench)
    except NotTested as missing_part:
        verdict, reason = Verdict.NOT_TESTED, str(missing_part)
    except Failed as failure:
        verdict, reason = Verdict.FAIL, str(failure)
    except Exception as failure:  # noqa: BLE001 - an adapter may fail in any way, and the others must still be judged
        verdict, reason = Verdict.FAIL, _explain(failure)
    for close in (*(fleet.close for fleet in bench.fleets), harness.close):
        try:
            with _host_limit(HOST_LIMIT_S):
                close()
        except Exception as failure:  # noqa: BLE001 - the same
            if verdict is not Verdict.FAIL:
                verdict, reason = Verdict.FAIL, f"while it was closed: {_explain(failure)}"
    return Outcome(clause, verdict, reason, tuple(bench.figures), time.perf_counter() - began_s), bench


def _explain(failure: BaseException) -> str:
    text = f"{type(failure).__name__}: {failure}"
    frame = failure.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    if frame is not None:
        code = frame.tb_frame.f_code
        text += f" (raised in {code.co_qualname}, {code.co_filename}:{frame.tb_lineno})"
    cause = failure.__cause__
    return text if cause is None else f"{text}; caused by {type(cause).__name__}: {cause}"


@contextmanager
def _host_limit(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in this thread after so long, where that can be done: in the main thread."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def give_up(_number: int, _frame: FrameType | None) -> None:
        raise TimeoutError(f"not done after {seconds:g} s on the host: a call blocks, or the robot's time stands still")

    before = signal.signal(signal.SIGALRM, give_up)
    began_s = time.monotonic()
    remaining_s, interval_s = signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        # Somebody else's timer, such as a test runner's, goes on where it was.
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        if remaining_s > 0.0:
            left_s = max(remaining_s - (time.monotonic() - began_s), 1e-3)
            signal.setitimer(signal.ITIMER_REAL, left_s, interval_s)

"""Judges an adapter: tries every clause on a bench of its own, whatever the others did."""

from __future__ import annotations

import errno
import signal
import sysconfig
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Final

import soter.conformance.clauses  # noqa: F401 - registers the clauses
from soter.conformance import diagnosis
from soter.conformance.bench import Bench
from soter.conformance.clause import CLAUSES, Clause, Tier
from soter.conformance.figure import Failed, NotTested
from soter.conformance.harness import Harness
from soter.conformance.record import Outcome, Record, Verdict, subject_of
from soter.conformance.tally import Tally
from soter.errors import ConfigError, nearest

CLOSE_LIMIT_S: Final = 30.0
"""Time on the host after which closing a fleet or a harness counts as hanging."""

_PYTHON: Final = sysconfig.get_path("stdlib")
_START_S: Final = 20.0
"""How long a harness may take to start its robots."""


def select(only: Sequence[str] = (), tiers: Collection[Tier] = ()) -> list[Clause]:
    """Return the clauses with these ids or in these groups; all of them if none is named.

    Args:
        only: ids and groups; includes the clauses `truth.` of the same names.
        tiers: only clauses of these tiers; all if none is named.

    Raises:
        ConfigError: there is no such clause.
    """
    wanted = set() if only else set(CLAUSES)
    for name in only:
        found = {
            key
            for key in CLAUSES
            if any(each == name or each.startswith(f"{name}.") for each in (key, key.removeprefix("truth.")))
        }
        if not found:
            raise ConfigError(f"there is no clause '{name}'{nearest(name, list(CLAUSES))}", key="--only")
        wanted |= found
    chosen = [each for key, each in CLAUSES.items() if key in wanted and (not tiers or each.tier in tiers)]
    if not chosen:
        raise ConfigError(f"none of {', '.join(only)} is in tier {' or '.join(each.value for each in tiers)}")
    return chosen


def judge(
    harness: Harness,
    clauses: Sequence[Clause] | None = None,
    on_outcome: Callable[[Outcome, Record], None] | None = None,
) -> Record:
    """Try clauses on an adapter in this process, one after another; a failed one does not stop the others.

    `soter.conformance.workshop` does so in processes of their own, where a crash does not either.
    """
    chosen = CLAUSES.values() if clauses is None else clauses
    tally = Tally(harness.name, chosen, on_outcome, given=not harness.starts_robots)
    for number, each in enumerate(tally.clauses):
        if tally.hopeless():
            tally.give_up(tally.clauses[number:])
            break
        outcome, bench = try_clause(each, harness)
        tally.add(outcome, subject_of(bench))
    return tally.record()


def try_clause(clause: Clause, harness: Harness) -> tuple[Outcome, Bench]:
    """Try one clause on a bench of its own; return the outcome, and the closed bench."""
    bench = Bench(harness, truth=clause.tier is Tier.TRUTH, needs=clause.needs)
    began_s = time.perf_counter()
    missing = [hook for hook in clause.hooks if not harness.gives(hook)]
    if missing:
        reason = f"hook{'s' if len(missing) > 1 else ''} not given: {', '.join(missing)}"
        return Outcome(clause, Verdict.NOT_TESTED, reason, (), 0.0), bench
    verdict, reason, unready = Verdict.PASS, "", False
    try:
        ready_s = min(2.0 * harness.connect_timeout_s + _START_S, harness.clause_limit_s)
        with _host_limit(ready_s, extended=lambda: harness.clause_limit_s if bench.capabilities else 0.0):
            clause.check(bench)
            if harness.judges and bench.always.wrong:
                raise Failed(bench.always.wrong)
    except NotTested as missing_part:
        verdict, reason = Verdict.NOT_TESTED, str(missing_part)
    except Failed as failure:
        verdict, reason = Verdict.FAIL, str(failure)
    except Exception as failure:  # noqa: BLE001 - an adapter may fail in any way, and the others must still be judged
        verdict, reason, unready = Verdict.FAIL, explain(failure), bench.capabilities is None
        # Errors in the kit itself come of missing samples.
        known = diagnosis.explain(bench) if isinstance(failure, LookupError | ValueError) else ""
        if isinstance(failure, IndexError | KeyError) and not known:
            reason += "; is a robot's id taken for an index? Ids are any numbers, in any order"
        if isinstance(failure, OSError) and failure.errno == errno.EMFILE:
            reason += "; files or sockets are opened again and again, and not closed"
        reason = known + reason
    finally:
        # However the clause ended, a robot must not be left driving.
        wrong = _close(bench)
    if wrong and verdict is not Verdict.FAIL:
        verdict, reason = Verdict.FAIL, f"while it was closed: {wrong}"
    host_s = time.perf_counter() - began_s
    return Outcome(clause, verdict, reason, tuple(bench.figures), host_s, unready), bench


def _close(bench: Bench) -> str:
    """Close what a clause has opened; return the first error, or nothing."""
    wrong = ""
    for close in (*(fleet.close for fleet in bench.fleets), bench.harness.close):
        try:
            with _host_limit(CLOSE_LIMIT_S):
                close()
        except Exception as failure:  # noqa: BLE001 - an adapter may fail in any way
            wrong = wrong or explain(failure)
    return wrong


def explain(failure: BaseException) -> str:
    """Return an error with the place that raised it, or called what of Python's own did, and its cause."""
    text = f"{type(failure).__name__}: {failure}"
    frame = failure.__traceback__
    at = None
    while frame is not None:
        file = frame.tb_frame.f_code.co_filename
        # Distributions may be installed in a folder of the standard library's.
        if at is None or "-packages" in file or not file.startswith((_PYTHON, __file__)):
            at = frame
        frame = frame.tb_next
    if at is not None:
        code = at.tb_frame.f_code
        text += f" (raised in {code.co_qualname}, {code.co_filename}:{at.tb_lineno})"
    cause = failure.__cause__
    return text if cause is None else f"{text}; caused by {type(cause).__name__}: {cause}"


@contextmanager
def _host_limit(seconds: float, extended: Callable[[], float] = lambda: 0.0) -> Iterator[None]:
    """Raise TimeoutError after some time, if this is the main thread; in others that is not possible.

    Args:
        seconds: the limit, on the host.
        extended: called at the limit; returns the limit that counts instead.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def give_up(_number: int, _frame: FrameType | None) -> None:
        limit_s, passed_s = extended(), time.monotonic() - began_s
        if passed_s < limit_s:
            signal.setitimer(signal.ITIMER_REAL, limit_s - passed_s)
            return
        raise TimeoutError(
            f"not done after {max(seconds, limit_s):g} s on the host: a call blocks, or the robot's time stands still"
        )

    began_s = time.monotonic()
    # Stop the timer first: another one that ends just now must not be taken for this one.
    remaining_s, interval_s = signal.setitimer(signal.ITIMER_REAL, 0.0)
    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        # Resume the timer that was running before, such as a test runner's.
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        if remaining_s > 0.0:
            left_s = max(remaining_s - (time.monotonic() - began_s), 1e-3)
            signal.setitimer(signal.ITIMER_REAL, left_s, interval_s)

"""Surroundings: whatever thread a program drives its robots in, and whoever else is on the network."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.conformance.figure import Failed, NotTested
from soter.conformance.usage import listening
from soter.errors import account_of, raised_at

_CODE: Final = 3
_MOMENT_S: Final = 0.5
_INTERRUPTS: Final = 6
_FIRST_S, _APART_S = 0.03, 0.013
_LOOPBACK: Final = ("127.", "::1", "::ffff:127.")


@clause("host.any_thread")
def any_thread(bench: Bench) -> None:
    """Robots are opened, driven and closed in any one thread of a program, and beside an event loop that runs in it."""
    for where, run in (("in a thread that is not the main one", _plainly), ("beside a running event loop", _in_a_loop)):
        _drive_elsewhere(bench, where, run)


def _plainly(drive: Callable[[], None]) -> None:
    drive()


def _in_a_loop(drive: Callable[[], None]) -> None:
    async def driven() -> None:
        drive()

    asyncio.run(driven())


def _drive_elsewhere(bench: Bench, where: str, run: Callable[[Callable[[], None]], None]) -> None:
    def drive() -> None:
        robot = bench.open_one()
        bench.go(robot, bench.place(robot, 0.2), cause=f"{where} it is opened, and does not obey")
        bench.close()

    raised: list[BaseException] = []

    def work() -> None:
        try:
            run(drive)
        except BaseException as failure:  # noqa: BLE001 - it is judged in the thread of the clause
            raised.append(failure)

    thread = threading.Thread(target=work, name="not the main one", daemon=True)
    thread.start()
    thread.join()
    for failure in raised:
        if isinstance(failure, Failed | NotTested):
            raise failure
        raise Failed(
            f"{where} it raised {account_of(failure)}{raised_at(failure)}: event loops and signals belong to the "
            "program that uses its robots; run a loop in a thread of the adapter's own"
        ) from failure


@clause("host.children")
def children(bench: Bench) -> None:
    """A program that somebody else has started from the same process ends with its own exit code."""
    if bench.harness.gives("killable"):
        bench.opener = lambda: bench.harness.killable().fleet
    robot = bench.open_one()
    child = subprocess.Popen([sys.executable, "-S", "-c", f"raise SystemExit({_CODE})"])
    # It is watched without taking its exit code, which is there to be taken once.
    with suppress(ChildProcessError):
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    bench.run(_MOMENT_S, lambda: bool(bench.fleet.lost()))
    bench.go(robot, bench.place(robot, 0.2))
    bench.close()
    code = child.wait()
    bench.require(
        code == _CODE,
        f"a program that was started beside the fleet has ended with {_CODE}, and whoever started it learns {code}: "
        "the adapter waits for any child of the process, by waitpid(-1), or ignores SIGCHLD; wait for your own by id",
    )


@clause("host.interrupted")
def interrupted(bench: Bench) -> None:
    """Ctrl-C comes out of whatever a program that drives robots is doing, such as waiting for its next tick."""
    if threading.current_thread() is not threading.main_thread():
        raise NotTested("signals come to the main thread of a program, and this is another one")
    bench.open_one()
    for number in range(_INTERRUPTS):
        bench.require(
            _is_interrupted(bench, _FIRST_S + number * _APART_S),
            f"Ctrl-C number {number + 1} (KeyboardInterrupt) got lost in a loop that reads states, renews leases and "
            "waits, as a run does: the adapter's clock, or another call of its, catches whatever is raised",
        )


class _Interrupted(KeyboardInterrupt):
    pass


def _is_interrupted(bench: Bench, after_s: float) -> bool:
    """Send this process SIGINT in a moment, and return whether that comes out of driving."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise _Interrupted

    before = signal.signal(signal.SIGINT, interrupt)
    timer = threading.Timer(after_s, os.kill, (os.getpid(), signal.SIGINT))
    ends_s = time.monotonic() + after_s + _MOMENT_S
    try:
        timer.start()
        while time.monotonic() < ends_s:
            bench.run(2 * TICK_S)
    except _Interrupted:
        return True
    finally:
        timer.join()
        signal.signal(signal.SIGINT, before)
    return False


@clause("host.alone", tier=Tier.WIRE)
def alone(bench: Bench) -> None:
    """What is started for simulated robots listens for TCP on this host only."""
    if not bench.harness.starts_robots:
        raise NotTested("the robots were there already, and whoever is to reach them was told")
    bench.open_one()
    found = listening()
    if found is None:
        raise NotTested("this system has no /proc, which says who listens")
    beyond = {port: who for (address, port), who in found.items() if not address.startswith(_LOOPBACK)}
    bench.require(
        not beyond,
        "it can be reached from beyond this host, at "
        f"{', '.join(f'port {port} of {who!r}' for port, who in sorted(beyond.items()))}: whoever is on the network "
        "may command its robots, or hear them; bind to 127.0.0.1 unless told otherwise",
    )

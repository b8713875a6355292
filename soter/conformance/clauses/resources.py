"""Resources: closing gives back all that opening took."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.conformance.figure import NotTested
from soter.conformance.usage import Usage, temporary_files, usage
from soter.errors import SoterError
from soter.sdk import Controller, Link

_WARM_UPS: Final = 2
"""Opens before counting begins: at the first one, libraries start threads and fill caches."""

_OPENS: Final = 4
_ROUNDS: Final = 3
"""How often growth must repeat to count as a leak: a pool that fills up stops growing."""

_BOUND: Final = 0.5
"""Growth per open, in pieces or MiB, above which a resource leaks."""

_SETTLE_S: Final = 0.5
_SHOWN: Final = 3
_IN_VAIN_S: Final = 0.3

_OUT_S: Final = 2.5
_BACK_S: Final = 5.0

_CLOSING: Final = (
    "the adapter's _disconnect() and Fleet._close(), or the harness's close(), must end and close what was started"
)

_NAMES: Final = {
    "threads": "threads", "descriptors": "file descriptors", "processes": "processes", "files": "temporary files",
    "memory_mib": "MiB of memory",
}  # fmt: skip
_COUNTED: Final = ("threads", "descriptors", "processes", "files")


@clause("resources.given_back")
def given_back(bench: Bench) -> None:
    """However often robots are opened, closing gives back threads, descriptors, processes, files and memory."""
    _see_it_given_back(bench, _open_and_close, "open")


@clause("resources.unready")
def unready(bench: Bench) -> None:
    """What is opened and never gets ready, because the robot does not answer, is given back as well."""
    _see_it_given_back(bench, _open_in_vain, "open of a robot that never got ready")


@clause("resources.outages", tier=Tier.WIRE, hooks=("cut",))
def outages(bench: Bench) -> None:
    """However often its link is cut, a robot is heard again behind it, and its adapter holds no more than before."""
    robot = bench.open_one()
    bench.faulty = True
    outages = count(1)

    def cut_and_restore(bench: Bench) -> None:
        bench.harness.cut(robot.id)
        bench.run(_OUT_S)
        bench.harness.restore(robot.id)
        bench.require(
            bench.run(_BACK_S, lambda: robot.read_state().link is Link.UP),
            f"{_BACK_S:.0f} s after outage number {next(outages)} no new sample has arrived: what connects anew "
            "must do so as often as it is needed",
        )
        del bench.tracks[robot.id][:-1]

    _see_it_given_back(
        bench, cut_and_restore, "outage", "what is opened anew while nothing is heard must take the place of what was "
        "open, which is to be closed",
    )  # fmt: skip


def _see_it_given_back(bench: Bench, do: Callable[[Bench], None], what: str, cause: str = _CLOSING) -> None:
    with temporary_files():
        _require_no_growth(bench, do, what, cause)


def _require_no_growth(bench: Bench, do: Callable[[Bench], None], what: str, cause: str) -> None:
    for _ in range(_WARM_UPS):
        do(bench)
    before, opens = _settled(None), 0
    least = dict.fromkeys(_NAMES, math.inf)
    left: dict[str, Sequence[str]] = {}
    while opens < _ROUNDS * _OPENS and max(least.values()) > _BOUND:
        for _ in range(_OPENS):
            do(bench)
        opens += _OPENS
        after = _settled(before)
        for name in _COUNTED:
            now, then = getattr(after, name), getattr(before, name)
            left[name] = [now[each] for each in now if each not in then]
            least[name] = min(least[name], (len(now) - len(then)) / _OPENS)
        least["memory_mib"] = min(least["memory_mib"], (after.memory_mib - before.memory_mib) / _OPENS)
        before = after
    leaks = []
    for name, grown in least.items():
        if grown > _BOUND:
            shown = f" ({', '.join(left[name][-_SHOWN:])})" if name in left else ""
            leaks.append(f"{grown:.2g} to {_NAMES[name]}{shown}")
    # The resource that grows most comes last, so that the others' figures are recorded when it fails the clause.
    for name, grown in sorted(least.items(), key=lambda each: each[1]):
        bench.measure(
            f"{name}_per_{what.split()[0]}", max(grown, 0.0), _BOUND, 0.0,
            f"every {what} adds {' and '.join(leaks)}, {opens} in a row; {cause}",
        )  # fmt: skip


def _open_and_close(bench: Bench) -> None:
    robot = bench.open_one()
    robot.goto(bench.place(robot, 0.2), Controller.AC)
    bench.run(4 * TICK_S)
    _close(bench)


def _open_in_vain(bench: Bench) -> None:
    fleet = bench.open_raw()
    if bench.harness.gives("cut"):
        bench.harness.cut(fleet.robots[0].id)
        with suppress(SoterError):
            fleet.robots[0].init(_IN_VAIN_S)
    _close(bench)


def _close(bench: Bench) -> None:
    bench.close()
    # The bench itself must not be what grows.
    del bench.fleets[:-1]


def _settled(before: Usage | None) -> Usage:
    """Return the usage once it is back to `before`, or no longer falls."""
    until_s = time.monotonic() + _SETTLE_S
    while True:
        gc.collect()
        now = usage()
        if now is None:
            raise NotTested("this system has no /proc, which says what a process holds")
        if before is None or time.monotonic() > until_s or all(
            len(getattr(now, name)) <= len(getattr(before, name)) for name in _COUNTED
        ):  # fmt: skip
            return now
        time.sleep(TICK_S)

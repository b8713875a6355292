"""Host: an adapter shares its process, and the host, with whatever runs there beside it."""

from __future__ import annotations

import gc
import locale
import logging
import math
import multiprocessing
import os
import random
import resource
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Mapping
from concurrent.futures import thread
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, Final, NamedTuple

import numpy as np

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S, drive_until
from soter.conformance.figure import Failed
from soter.conformance.wall_clock import set_by, taken_over
from soter.sdk import Controller, Fleet, GoalStatus, Robot, Waypoint

# A logger of somebody else's, as far as adapters know.
_beside: Final = logging.getLogger(f"{__name__}.beside")

_BEGAN_IN: Final = Path.cwd()
"""The working directory before any adapter was opened."""


def _taken_from_host() -> dict[str, object]:
    """Return what the kernel and Python grant this process, by what sets it."""
    limits = {name: getattr(resource, name) for name in dir(resource) if name.startswith("RLIMIT_")}
    return {
        "os.nice()": os.getpriority(os.PRIO_PROCESS, 0),
        # Not every system has it.
        "os.sched_setaffinity()": os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None,
        **{f"resource.setrlimit({name})": resource.getrlimit(number) for name, number in limits.items()},
        "sys.setrecursionlimit()": sys.getrecursionlimit(),
    }


_AT_FIRST: Final = _taken_from_host()
"""Before any adapter was opened: nothing else here changes it."""

_MASK: Final = 0o026
_INTERVAL_S: Final = 0.004

_STOPS: Final = (signal.SIGINT, signal.SIGTERM)
_HANDLED: Final = (*_STOPS, signal.SIGALRM, signal.SIGCHLD, signal.SIGHUP, signal.SIGPIPE, signal.SIGQUIT)
_SEEDS: Final = (1, 2)

_LOOKS_S: Final = 0.2
_LOOKS: Final = 15
_JUDGED: Final = 4
"""Looks that are judged together: what was begun when robots were opened may go on for a moment."""

_IDLE, _BUSY = 0.1, 0.5
_MOMENT_S: Final = 0.004
_TASKS: Final = Path("/proc/self/task")

_STAYS_S: Final = 0.5

_WALL_SET_S: Final = (5.0, -3.0)
_WALL_LOOK_S: Final = 1.0
_WALL_OFF_S: Final = 0.5


@clause("host.shared")
def shared(bench: Bench) -> None:
    """What belongs to the whole process is left alone: its signals, settings and random numbers; and it may end."""
    dice, numpy_dice, drawn = random.getstate(), np.random.get_state(), []
    try:
        with _stops_noted() as noted, _set_otherwise():
            for seed in _SEEDS:
                random.seed(seed)
                np.random.seed(seed)
                _see_it_left_alone(bench, noted)
                drawn.append({"random.seed()": random.random(), "numpy.random.seed()": np.random.random()})
    finally:
        random.setstate(dice)
        np.random.set_state(numpy_dice)
    for what, first in drawn[0].items():
        bench.require(
            first != drawn[1][what],
            "whatever the random numbers of the process were seeded with, they go on alike once robots were opened: "
            f"the adapter calls {what}, and whoever draws at random beside it draws the same each time; use a "
            "generator of its own",
        )


def _see_it_left_alone(bench: Bench, noted: list[int]) -> None:
    _beside.disabled = False
    before, threads = _settings() | _AT_FIRST, {*threading.enumerate()}
    robot = bench.open_one()
    robot.goto(bench.place(robot, 0.2), Controller.AC)
    bench.run(4 * TICK_S)
    _require_same(before, "while robots are open")
    if noted is not _NOT_MAIN:
        for number in _STOPS:
            noted.clear()
            signal.raise_signal(number)
            if number not in noted:
                raise Failed(
                    f"while robots are open {signal.Signals(number).name} does not reach who asked for it before: "
                    "the adapter, or a library of it, takes it for itself, so that Ctrl-C does not end the run; have "
                    "it install no handlers"
                )
    if bench.caps.in_process:
        # Of adapters on a wire `process.ends` finds out, whatever their threads are made with.
        # Those of a pool end with the program.
        pooled = getattr(thread, "_threads_queues", {})
        began = [each for each in threading.enumerate() if each not in threads and each not in pooled]
        held = [each.name for each in began if not each.daemon]
        bench.require(
            not held,
            f"it has started {', '.join(held)}, which is no daemon: a program that ends by an error, and does not "
            "close its robots, never ends; start it with daemon=True",
        )
    bench.close()
    del bench.fleets[:-1]
    _require_same(before, "after robots were closed")


@contextmanager
def _set_otherwise() -> Iterator[None]:
    """Set for a while what an adapter may have set for itself when it was opened before."""
    root = logging.root
    folder, mask, patience_s = Path.cwd(), os.umask(_MASK), socket.getdefaulttimeout()
    collects, interval_s, off, level, handlers = (
        gc.isenabled(), sys.getswitchinterval(), root.manager.disable, root.level, [*root.handlers]
    )  # fmt: skip
    try:
        # Programs that a harness starts may have relative paths, and so this is no folder of its own.
        os.chdir(_BEGAN_IN)
        socket.setdefaulttimeout(None)
        gc.enable()
        sys.setswitchinterval(_INTERVAL_S)
        logging.disable(logging.NOTSET)
        root.handlers.clear()
        yield
    finally:
        os.chdir(folder)
        os.umask(mask)
        socket.setdefaulttimeout(patience_s)
        if not collects:
            gc.disable()
        sys.setswitchinterval(interval_s)
        logging.disable(off)
        root.setLevel(level)
        root.handlers[:] = handlers


def _settings() -> dict[str, object]:
    """Return what a library may have set for the whole process, by what sets it."""
    mask = os.umask(0o022)
    os.umask(mask)
    return {
        **{f"the handler of {each.name}": signal.getsignal(each) for each in _HANDLED},
        "os.chdir()": os.getcwd(),  # noqa: PTH109 - of the process
        "os.umask()": mask,
        "socket.setdefaulttimeout()": socket.getdefaulttimeout(),
        "sys.setswitchinterval()": sys.getswitchinterval(),
        "gc.disable()": gc.isenabled(),
        **{f"os.environ['{name}']": said for name, said in os.environ.items() if not name.startswith("PYTEST")},
        "sys.path": [*sys.path],
        "sys.excepthook": sys.excepthook,
        "threading.excepthook": threading.excepthook,
        "sys.stdout": (sys.stdout, sys.stderr),
        "warnings.filters": [*warnings.filters],
        "numpy.seterr()": np.geterr(),
        # Python itself sets it, to the first that it has, once it is used.
        "multiprocessing.set_start_method()": multiprocessing.get_start_method(allow_none=True)
        or multiprocessing.get_all_start_methods()[0],
        "locale.setlocale()": locale.setlocale(locale.LC_ALL),
        "logging.disable()": logging.root.manager.disable,
        "logging.basicConfig()": (logging.root.level, [*logging.root.handlers]),
        "logging.config, which disables loggers unless it is told disable_existing_loggers=False,": _beside.disabled,
    }


def _require_same(before: Mapping[str, object], when: str) -> None:
    now = _settings() | _taken_from_host()
    for what in {**before, **now}:
        found, was = now.get(what), before.get(what)
        if found == was:
            continue
        if isinstance(found, list) and isinstance(was, list) and {*map(repr, found)} != {*map(repr, was)}:
            found, was = [each for each in found if each not in was], [each for each in was if each not in found]
        # What an environment holds may be a secret.
        shown = "" if what.startswith("os.environ") else f", {found!r} for {was!r}"
        raise Failed(
            f"{when} {what} is another one{shown}: it belongs to the whole process, and whatever else runs there "
            "relies on it, such as Ctrl-C on a handler; leave it alone"
        )


_NOT_MAIN: Final[list[int]] = []


@contextmanager
def _stops_noted() -> Iterator[list[int]]:
    """Note the signals that are to stop a program, instead of stopping this one; the main thread alone can."""
    if threading.current_thread() is not threading.main_thread():
        yield _NOT_MAIN
        return
    noted: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        noted.append(number)

    before: dict[signal.Signals, Any] = {each: signal.signal(each, note) for each in _STOPS}
    try:
        yield noted
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


class _Thread(NamedTuple):
    """What the kernel has counted of a thread.

    Attributes:
        run_s: how long it has run.
        waited_s: how long it has waited for a core.
        slept: how often it has waited for anything else.
        runnable: whether it runs, or waits for a core, now.
    """

    run_s: float
    waited_s: float
    slept: int
    runnable: bool


@clause("host.idle")
def idle(bench: Bench) -> None:
    """A fleet at rest leaves the host to others: no thread of it takes half a core."""
    bench.open_one()
    looks = [(time.perf_counter(), _threads())]
    share = 0.0
    while len(looks) <= _LOOKS:
        time.sleep(_LOOKS_S)
        looks.append((time.perf_counter(), _threads()))
        share = _busiest(*looks[-2:])
        # One that would run, and has not got a core yet, is looked at again.
        if share <= _IDLE and not any(each.runnable for each in looks[-1][1].values()):
            break
        share = _busiest(looks[max(len(looks) - 1 - _JUDGED, 0)], looks[-1])
        if len(looks) > _JUDGED and share > _BUSY:
            break
    bench.measure(
        "busy_share", share, _BUSY, 0.0, "of a robot at rest that nobody asks for anything a thread keeps a core busy: "
        "it polls and does not wait; ticks are late where others need the host, or several fleets run there",
    )  # fmt: skip


def _threads() -> dict[str, _Thread]:
    """Return the threads of this process, but for the one that asks; none on systems that do not count."""
    found = {}
    for each in _TASKS.iterdir() if _TASKS.is_dir() else ():
        # It may have ended meanwhile.
        with suppress(OSError, ValueError, LookupError):
            run_ns, waited_ns, _ = map(int, (each / "schedstat").read_text(encoding="ascii").split())
            status = (each / "status").read_text(encoding="utf-8", errors="replace")
            said = dict(line.partition(":")[::2] for line in status.splitlines())
            slept, runnable = int(said["voluntary_ctxt_switches"]), said["State"].strip().startswith("R")
            if int(each.name) != threading.get_native_id():
                found[each.name] = _Thread(1e-9 * run_ns, 1e-9 * waited_ns, slept, runnable)
    return found


def _busiest(before: tuple[float, Mapping[str, _Thread]], after: tuple[float, Mapping[str, _Thread]]) -> float:
    """Return the largest share of the time, but that in which it waited for a core, that a thread has run.

    One that sleeps again after a moment does not count: where the host is busy, it waits for a core most of the time.
    """
    shares = [0.0]
    for name, now in after[1].items():
        was = before[1].get(name, _Thread(0.0, 0.0, 0, False))
        run_s, waited_s, slept = now.run_s - was.run_s, now.waited_s - was.waited_s, now.slept - was.slept
        if run_s > _MOMENT_S * (slept + 1):
            # One that has not slept at all may still wait for a core, which is counted when it gets one.
            shares.append(run_s / max(after[0] - before[0] - waited_s, run_s) if slept else 1.0)
    return max(shares)


@clause("host.beside")
def beside(bench: Bench) -> None:
    """Fleets that are open at once in one process know nothing of each other, though their robots' ids are alike."""
    bench.require_hook("another")
    robot = bench.open_one()
    harness = bench.harness.another()
    try:
        with harness.open(1) as fleet:
            (other,) = fleet.robots
            other.init(harness.connect_timeout_s)
            other.switch_ac_sc(Controller.AC, "conformance")
            before = other.read_state()[3:5]
            alike = f"robot {robot.id} of one fleet is taken for robot {other.id} of another one that is open as well"
            bench.go(robot, bench.place(robot, 0.2), cause=f"{alike}, which hears what it is told")
            bench.settle()
            _require_unmoved(bench, fleet, other, before, alike)
            at = bench.look(robot)
            target = bench.place(other, -0.2)
            reached = _goes(fleet, other, target, bench.way_s())
            bench.require(
                reached, f"{alike}, and no more obeys: what is known of robots is kept by their ids, once for a process"
            )
            bench.run(_STAYS_S)
            moved_m = bench.look(robot).distance_m(at.x_m, at.y_m)
            bench.require(moved_m <= bench.held_m, f"{alike}: it moved by {moved_m:.2f} m for the other one's goal")
    finally:
        harness.close()
    bench.go(
        robot, bench.place(robot, -0.1),
        cause="once another fleet in the process was closed this one does not obey: what both share, such as a "
        "library's context, was ended with it",
    )  # fmt: skip


def _goes(fleet: Fleet, robot: Robot, target: Waypoint, within_s: float) -> bool:
    goal = robot.goto(target, Controller.AC)
    drive_until(fleet, lambda: not goal.active, within_s)
    return goal.status is GoalStatus.REACHED


def _require_unmoved(bench: Bench, fleet: Fleet, robot: Robot, at: tuple[float, float], alike: str) -> None:
    drive_until(fleet, lambda: False, _STAYS_S)
    moved_m = math.dist(robot.read_state()[3:5], at)
    bench.require(moved_m <= bench.held_m, f"{alike}: that one moved by {moved_m:.2f} m for its goal")


@clause("host.wall_clock")
def wall_clock(bench: Bench) -> None:
    """The host's wall clock is set now and then, also back: fleet time goes on evenly, and samples stay fresh."""
    with taken_over():
        robot = bench.open_one()
        bench.run(_WALL_LOOK_S)
        for by_s in _WALL_SET_S:
            _require_even(bench, robot, by_s)


def _require_even(bench: Bench, robot: Robot, by_s: float) -> None:
    """Judge fleet time and the age of samples while the wall clock is set."""
    caps, way = bench.caps, "forward" if by_s > 0.0 else "back"
    cause = "it is counted by time.time(), or another clock that people and NTP set; count by time.monotonic()"
    host_s, fleet_s = time.perf_counter(), bench.now_s
    set_by(by_s)
    now_s = bench.now_s
    passed_s = (time.perf_counter() - host_s) * bench.harness.speedup
    went_s = now_s - fleet_s
    was_set = f"the host's wall clock was set {way} by {abs(by_s):g} s"
    bench.require(
        -_WALL_OFF_S < went_s < passed_s + _WALL_OFF_S,
        f"as {was_set}, fleet time went on by {went_s:.2f} s at once: {cause}",
    )
    bench.run(_WALL_LOOK_S)
    state = robot.read_state()
    age_s = bench.now_s - state.stamp_s
    bench.require(
        -_WALL_OFF_S < age_s < caps.sample_age_s + _WALL_OFF_S,
        f"{was_set}, and samples are said to be {age_s:.2f} s old, the link {state.link.value}: the time at which they "
        f"arrive is {cause.removeprefix('it is ')}",
    )
    set_by(0.0)
    bench.run(_WALL_LOOK_S)

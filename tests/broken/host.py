"""Adapters that forget that the process, the host and the bus are not theirs alone; one line of a table each."""

from __future__ import annotations

import asyncio
import logging
import os
import random
import signal
import socket
import sys
import threading
from collections.abc import Callable
from typing import Any, ClassVar, Final

import numpy as np

from soter.onboard.mux import Mux
from soter.sdk import Capabilities, RobotState
from tests.broken.edits import edited, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.conformance.wire import WireRobot

_log: Final = logging.getLogger(__name__)

_SEVEN_BITS: Final = 0x7F
_RECURSIONS: Final = sys.getrecursionlimit()


def _opening(take: Callable[[Any], object]) -> Callable[..., None]:
    """Return an `__init__` that takes something of the process's."""

    def begin(self: Any, *arguments: Any) -> None:
        Broken.__init__(self, *arguments)
        take(self)

    return begin


def _on_a_bus(self: Any) -> None:
    self._mux = self._world.__dict__.setdefault("nodes", {}).setdefault(self.id & _SEVEN_BITS, self._mux)


def _hears(daemon: bool, listen: Callable[[threading.Event], object]) -> dict[str, Callable[..., None]]:
    """Return parts of an adapter with a thread that ends once it is closed."""

    def begin(self: Any) -> None:
        self.over = threading.Event()
        self.thread = threading.Thread(target=listen, args=(self.over,), name="hears", daemon=daemon)
        self.thread.start()

    def end(self: Any, timeout_s: float) -> None:
        Broken._disconnect(self, timeout_s)
        self.over.set()
        self.thread.join()

    return {"__init__": _opening(begin), "_disconnect": end}


def _polls(over: threading.Event) -> None:
    while not over.is_set():
        pass


class _Known:
    """What a module of an adapter knows."""

    muxes: ClassVar[dict[int, Mux[Any, Any]]] = {}
    open: ClassVar[bool] = False


def _by_number(hook: str) -> Callable[..., None]:
    def call(self: Any, *arguments: Any) -> None:
        own, self._mux = self._mux, _Known.muxes[self.id]
        try:
            getattr(Broken, hook)(self, *arguments)
        finally:
            self._mux = own

    return call


def _while_open(hook: str) -> Callable[..., None]:
    def call(self: Any, *arguments: Any) -> None:
        if _Known.open:
            getattr(Broken, hook)(self, *arguments)

    return call


def _begins(_: Any) -> None:
    _Known.open = True


def _ends(self: Any, timeout_s: float) -> None:
    Broken._disconnect(self, timeout_s)
    _Known.open = False


def _by_the_loop_of_the_thread(self: Any, timeout_s: float) -> Capabilities:
    asyncio.get_event_loop()
    return Broken._connect(self, timeout_s)


def _by_a_loop_for_a_moment(self: Any, timeout_s: float) -> Capabilities:
    loop = asyncio.new_event_loop()
    try:
        loop.call_soon(loop.stop)
        loop.run_forever()
    finally:
        loop.close()
    return Broken._connect(self, timeout_s)


def _set_while_open(sets: Callable[[int], object]) -> dict[str, Callable[..., None]]:
    """Return parts of an adapter that sets something otherwise while its robots are open."""

    def begin(self: Any, *arguments: Any) -> None:
        Broken.__init__(self, *arguments)
        sets(1)

    def end(self: Any, timeout_s: float) -> None:
        Broken._disconnect(self, timeout_s)
        sets(0)

    return {"__init__": begin, "_disconnect": end}


def _limits(on: int) -> None:
    sys.setrecursionlimit(_RECURSIONS + on)


def _environs(on: int) -> None:
    os.environ.update(SOTER_BROKEN="1") if on else os.environ.pop("SOTER_BROKEN", None)


def _says_where_it_is(self: Any) -> RobotState:
    state: RobotState = self._honest()
    print(state.x_m, state.y_m)
    return state


def _complains(self: Any) -> RobotState | None:
    if self.faults.cut:
        _log.warning("nothing is heard of robot %d", self.id)
    return WireRobot._sample(self)


HOST: Final[tuple[type[Broken], ...]] = (
    edited("SevenBits", "Knows robots by seven bits of their numbers.", "several.goto", "wrong robot",
           __init__=_opening(_on_a_bus)),
    edited("OwnInterrupt", "Has a handler of its own for Ctrl-C.", "host.shared", "handler of SIGINT",
           __init__=_opening(lambda _: signal.signal(signal.SIGINT, lambda *_: None))),
    edited("Seeds", "Seeds the random numbers of the whole process.", "host.shared", "random.seed",
           __init__=_opening(lambda _: random.seed(0))),
    edited("SeedsNumpy", "Seeds the random numbers that numpy has for the whole process.", "host.shared",
           "numpy.random.seed", __init__=_opening(lambda _: np.random.seed(0))),
    edited("OwnLimit", "Sets how deep the whole process may recurse.", "host.shared", "setrecursionlimit",
           **_set_while_open(_limits)),
    edited("OwnEnvironment", "Sets a variable in the environment of the process.", "host.shared", "SOTER_BROKEN",
           **_set_while_open(_environs)),
    edited("LoopOfTheThread", "Takes the event loop of the main thread for granted.", "host.any_thread",
           "event loops", _connect=_by_the_loop_of_the_thread),
    edited("LoopForAMoment", "Runs an event loop where it is opened, as if none ran there.", "host.any_thread",
           "event loops", _connect=_by_a_loop_for_a_moment),
    edited("Prints", "Prints where it is.", "host.quiet", "standard output", _sample=_says_where_it_is),
    edited("OwnTimeOut", "Sets a time-out for all sockets of the process.", "host.shared", "setdefaulttimeout",
           __init__=_opening(lambda _: socket.setdefaulttimeout(1.0))),
    edited("NoDaemon", "Hears in a thread that ends when it is closed only, and is waited for.", "host.shared",
           "no daemon", **_hears(False, threading.Event.wait)),
    edited("Polls", "Polls and does not wait.", "host.idle", "busy_share", **_hears(True, _polls)),
    edited("OneTableForAll", "Keeps robots of all fleets in a process by their numbers.", "host.beside", "is taken for",
           __init__=_opening(lambda self: _Known.muxes.update({self.id: self._mux})),
           **{hook: _by_number(hook) for hook in ("_send_goto", "_hand_over", "_renew_lease", "_halt")}),
    edited("OneContext", "Ends with a fleet what all fleets in a process share.", "host.beside", "ended with it",
           __init__=_opening(_begins), _disconnect=_ends,
           **{hook: _while_open(hook) for hook in ("_send_goto", "_renew_lease")}),
)  # fmt: skip

HOST_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    wired("Complains", "Logs at each tick that it hears nothing.", "host.quiet", "its link was cut",
          _sample=_complains),
)  # fmt: skip

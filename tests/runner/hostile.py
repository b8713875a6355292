"""ACs that turn on whoever runs them. Each drives for a while and then does what its name says, for ever."""

from __future__ import annotations

import contextlib
import ctypes
import os
import socket
import sys
import time
from typing import Any, NoReturn

from soter.controllers import Arena, Velocity, VelocityController
from soter.controllers.adversaries import Adversary
from soter.isolation.messages import Turn, encode
from soter.sdk import RobotState, Waypoint

FROM_S = 1.5
TICK = 30
"""One that has been answered by then, or soon will be."""


class Hostile(Adversary):
    """Behaves for `FROM_S`."""

    began_s: float | None = None

    def act(self, now_s: float, tick: int) -> None:
        self.began_s = now_s if self.began_s is None else self.began_s
        if now_s - self.began_s >= FROM_S:
            self.strike()
        for port in self.arena.ports.values():
            if port.engaged:
                port.goto(Waypoint(2.5, 4.5))

    def strike(self) -> None:
        """Do the deed; may return and be called again at the next tick."""


class LoadsForLong(Hostile):
    """Does nothing worse."""

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        time.sleep(2.0)


class Hangs(Hostile):
    def strike(self) -> None:
        time.sleep(600.0)


class Spins(Hostile):
    def strike(self) -> None:
        while True:
            pass


class SpinsInC(Hostile):
    """Never lets another thread of its interpreter run."""

    def strike(self) -> None:
        sum(range(10**12))


class Exits(Hostile):
    def strike(self) -> None:
        os._exit(7)


class Crashes(Hostile):
    def strike(self) -> None:
        ctypes.string_at(0)


class EatsMemory(Hostile):
    def strike(self) -> None:
        eaten = []
        while True:
            eaten.append(bytearray(1 << 24))


class Raises(VelocityController):
    """One for each robot, that says how fast instead of where to."""

    began_s: float | None = None

    def velocity(self, own: RobotState, now_s: float) -> Velocity:
        self.began_s = now_s if self.began_s is None else self.began_s
        if now_s - self.began_s >= FROM_S:
            raise ZeroDivisionError("no way")
        return Velocity(0.1, 0.2)


class Chatters(Hostile):
    """Fills its standard output."""

    def strike(self) -> None:
        while True:
            print("\x1b[2J" + "a" * 1000)


def link() -> socket.socket:
    """The socket to the supervisor, which an AC has no business with."""
    return socket.socket(fileno=os.dup(int(sys.argv[1])))


class FloodsWithTurns(Hostile):
    def strike(self) -> None:
        supervisor, data = link(), encode(Turn(TICK))
        while True:
            supervisor.send(data)


class FloodsWithGarbage(Hostile):
    def strike(self) -> None:
        supervisor = link()
        while True:
            supervisor.send(os.urandom(50_000))


class SendsTooMuch(Hostile):
    def strike(self) -> None:
        link().send(bytes(150_000))
        time.sleep(600.0)


class NeverReads(Hostile):
    """Answers ticks that it has not seen."""

    def strike(self) -> None:
        supervisor = link()
        for tick in range(TICK, 10**9):
            with contextlib.suppress(BlockingIOError):
                supervisor.send(encode(Turn(tick)), socket.MSG_DONTWAIT)
            time.sleep(0.002)


class Closes(Hostile):
    def strike(self) -> None:
        os.close(int(sys.argv[1]))
        time.sleep(600.0)


class Detaches(Hostile):
    """Leaves a process behind that holds on to its output."""

    def strike(self) -> None:
        if os.fork() == 0:
            os.setsid()
            time.sleep(5.0)
        os._exit(0)


def ends(*_: Any, **__: Any) -> NoReturn:
    """A factory that takes its process with it."""
    os._exit(3)

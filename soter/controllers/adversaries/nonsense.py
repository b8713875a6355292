"""Adversaries that send nonsense, or nothing, or fail."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from soter.controllers.adversaries.base import Adversary
from soter.controllers.base import Arena
from soter.sdk import Waypoint


class Traitor(float):
    """A number that raises when it is used in arithmetic."""

    def __rsub__(self, other: Any) -> float:
        raise ArithmeticError("this number does not want to be subtracted from")

    def __sub__(self, other: Any) -> float:
        raise ArithmeticError("this number does not want to be subtracted from")

    def __mul__(self, other: Any) -> float:
        raise ArithmeticError("this number does not want to be multiplied")

    __rmul__ = __mul__


class LookAlike:
    """Has the fields of a waypoint, and a check of its own that passes everything."""

    x_m = y_m = z_m = math.nan
    heading_rad = speed_m_s = None
    radius_m = timeout_s = 1.0

    def check(self, max_coordinate_m: float = math.inf) -> None:
        """Pass everything."""


class Endless(tuple[Waypoint, ...]):
    """Endless intentions."""

    __slots__ = ()

    def __iter__(self) -> Iterator[Waypoint]:
        while True:
            yield Waypoint(0.0, 0.0)


def _commands() -> list[Any]:
    numbers = [math.nan, math.inf, -math.inf, 1e308, -1e308, 1e9, 10**400, Traitor(2.5)]
    bad: list[Any] = [*numbers, True, "2.5", b"1", None, [], {}, object(), 1j]
    commands: list[Any] = [Waypoint(value, 2.5) for value in bad]
    commands += [Waypoint(2.5, value) for value in bad]
    commands += [Waypoint(2.5, 2.5, value) for value in bad]
    commands += [Waypoint(2.5, 2.5, 0.0, value) for value in bad]
    commands += [Waypoint(2.5, 2.5, 0.0, None, value) for value in [*bad, 0.0, -1.0, 5e-324]]
    commands += [Waypoint(2.5, 2.5, 0.0, None, None, value) for value in [*bad, 0.0, -1.0]]
    commands += [Waypoint(2.5, 2.5, 0.0, None, None, 0.1, value) for value in [*bad, 0.0, -1.0, 5e-324]]
    commands += [None, 0, math.nan, "goto", (1.0, 2.0), LookAlike(), LookAlike, Waypoint, object(), [Waypoint(1, 1)]]
    return commands


class Nonsense(Adversary):
    """Sends NaN, infinities, wrong types, absurd or raising numbers; now and then a real goal beyond the fence.

    The real goals keep the robots moving, and make them lose control while nonsense is pending.
    """

    def begin(self, arena: Arena) -> None:
        super().begin(arena)
        self._random = arena.random("nan")
        self._commands = _commands()

    def act(self, now_s: float, tick: int) -> None:
        """Send something to every robot, in control or not."""
        random = self._random
        low_x, low_y, high_x, high_y = self.arena.terrain.bounds
        for port in self.arena.ports.values():
            if random.random() < 0.05:
                x_m = random.uniform(low_x - 1.0, high_x + 1.0)
                port.goto(Waypoint(x_m, random.uniform(low_y - 1.0, high_y + 1.0)))
                continue
            upcoming: Any = random.choice(((), Endless(), None, 7, (None, Waypoint(math.nan, math.inf))))
            port.goto(random.choice(self._commands), upcoming)


class Frozen(Adversary):
    """Never sends anything. Its robots stand where they are, and go home when they have to charge."""

    def act(self, now_s: float, tick: int) -> None:
        """Nothing."""


class Raises(Adversary):
    """Fails at once and for good: safe controllers have its robots from the first tick on."""

    def act(self, now_s: float, tick: int) -> None:
        """Fail.

        Raises:
            RuntimeError: always.
        """
        raise RuntimeError("this adversary always fails")

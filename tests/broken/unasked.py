"""Adapters whose robots go on with what nobody asks for any more, one line of a table each."""

from __future__ import annotations

from typing import Any, Final

from soter.sdk import Goal
from tests.broken.edits import driven, edited
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import memory
from tests.conformance.wire import Vehicle

_PLANS_EVERY_S: Final = 0.2
_SLOW_M_S: Final = 0.005
_ROUNDING: Final = 1e-6


def _planned(robot: Any, goal: Goal | None, now_s: float, speed_m_s: float) -> Goal | None:
    """Return what is driven to: on its way to one goal it takes the next one up where a cycle begins."""
    planned = memory(robot, "planned", lambda: [None])
    waits = goal is not None and planned[0] is not None and planned[0].by is goal.by and abs(speed_m_s) > _SLOW_M_S
    if not waits or (now_s + _ROUNDING) % _PLANS_EVERY_S < 2.0 * _ROUNDING:
        planned[0] = goal
    return planned[0]  # type: ignore[no-any-return]


def _in_cycles(self: Any, timeout_s: float) -> Any:
    found, vehicle = Broken._connect(self, timeout_s), self._vehicle

    def control(now_s: float, *state: float) -> tuple[float, float]:
        goal = _planned(self, vehicle.mux.passing(now_s), now_s, state[3])
        return vehicle._drive.command(*state, None if goal is None else goal.target)  # type: ignore[no-any-return]

    self._world.set_control(self.id, control)
    return found


def _passing_in_cycles(self: Any, clock_s: float) -> Goal | None:
    return _planned(self, Vehicle.passing(self, clock_s), self.world.now_s, self.world.bodies.v[self.index])


UNASKED: Final[tuple[type[Broken], ...]] = (
    edited("PlansInCycles", "Takes up a goal that replaces another on its way in the next of cycles of 0.2 s.",
           "goal.replaced", "cycles that are longer", _connect=_in_cycles),
)  # fmt: skip

UNASKED_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("PlansInCycles", "Takes up a goal that replaces another on its way in the next of cycles of 0.2 s.",
           "goal.replaced", "cycles that are longer", passing=_passing_in_cycles),
)  # fmt: skip

"""What broken adapters are made of: what one remembers, and hooks and edits that several share."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from soter.adapters.pybullet.backend import KinematicRobot
from soter.conformance.find import open_floor
from soter.sdk import RobotState
from soter_sim import LIMITS
from tests.broken.in_process import Broken

FIRST, SECOND, THIRD = (place.id for place in open_floor().robots)


class Exact(Broken):
    """Promises its acceleration, and exact velocities and headings; the base of what does not keep that."""

    caught_by = ""
    declared = KinematicRobot.declared


def memory(robot: Any, name: str, made: Callable[[], Any]) -> Any:
    """Return something that a robot keeps for an edit."""
    kept: dict[str, Any] = robot.__dict__.setdefault("kept", {})
    if name not in kept:
        kept[name] = made()
    return kept[name]


def counted(robot: Any, name: str = "count") -> int:
    """Return how often this was called for a robot, by what is counted."""
    counts = memory(robot, name, lambda: [0])
    counts[0] += 1
    return int(counts[0])


def ago(robot: Any, state: RobotState, samples: int) -> RobotState:
    """Return the sample of so many samples ago."""
    past = memory(robot, "past", list)
    if not past or state.stamp_s > past[-1].stamp_s:
        past.append(state)
        del past[: -samples - 1]
    return past[0]  # type: ignore[no-any-return]


def scaled(state: RobotState, by: float) -> RobotState:
    """Return a sample with its speed multiplied."""
    return state._replace(vx_m_s=by * state.vx_m_s, vy_m_s=by * state.vy_m_s)


def once_in(many: int, **bad: float) -> Callable[[Any, RobotState], RobotState]:
    """Return an edit that puts bad values into one sample of so many."""
    return lambda robot, state: state._replace(**bad) if counted(robot) % many == 0 else state  # type: ignore[arg-type]


def with_control(
    edit: Callable[[Any, tuple[float, ...], float, float], tuple[float, float]],
) -> Callable[[Any, float], Any]:
    """Return a `_connect` after which the vehicle's own control is edited: robot, state, speed, turn rate."""

    def connect(self: Any, timeout_s: float) -> Any:
        honest = self._vehicle.control
        found = Broken._connect(self, timeout_s)
        self._world.set_control(self.id, lambda *state: edit(self, state, *honest(*state)))
        return found

    return connect


def leased(seconds: float, robot_id: int | None = None) -> Callable[..., None]:
    """Return an `__init__` by which the lease, of one robot or of all, is so long."""

    def begin(self: Any, *arguments: Any) -> None:
        Broken.__init__(self, *arguments)
        if robot_id in (None, self.id):
            self._mux.lease_s = seconds

    return begin


def braking_at(share: float) -> Callable[[Any, tuple[float, ...], float, float], tuple[float, float]]:
    """Return a control that lets the speed fall no faster than this share of the promise."""

    def edit(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
        slowest = abs(state[4]) - share * LIMITS.brake_m_s2 * robot._world.period_s
        return (math.copysign(max(abs(speed), slowest), state[4]) if abs(speed) < slowest else speed), rate

    return edit


def acting_late(
    periods: int, *, gotos: bool = True, halts: bool = True, every: int = 1
) -> dict[str, Callable[..., None]]:
    """Return hooks that act so many periods later."""

    def later(self: Any, act: Callable[[], object]) -> None:
        memory(self, "due", list).append((self._world.now_s + periods * self._world.period_s, act))

    def send(self: Any, goal: Any) -> None:
        if gotos and counted(self, "sent") % every == 0:
            later(self, lambda: self._mux.give(goal.by, goal, self._world.now_s))
        else:
            Broken._send_goto(self, goal)

    def halt(self: Any) -> None:
        if halts and counted(self, "halted") % every == 0:
            later(self, self._mux.halt)
        else:
            Broken._halt(self)

    def connect(self: Any, timeout_s: float) -> Any:
        honest = self._vehicle.control
        found = Broken._connect(self, timeout_s)

        def control(*state: float) -> Any:
            due = memory(self, "due", list)
            while due and due[0][0] <= state[0] + 1e-6:
                due.pop(0)[1]()
            return honest(*state)

        self._world.set_control(self.id, control)
        return found

    return {"_send_goto": send, "_halt": halt, "_connect": connect}

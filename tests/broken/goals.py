"""Adapters in process that are wrong in how they take goals and drive to them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, ClassVar, Final

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.sdk import Capabilities, Controller, Goal, GoalStatus, RobotState, Waypoint
from soter_sim import LIMITS
from tests.broken.edits import targeted
from tests.broken.in_process import Broken, not_cancelled
from tests.broken.parts import (
    memory,
)


class NoOpStop(Broken):
    """Documents a stop that does nothing."""

    caught_by = "goal.cancel"

    def _halt(self) -> None:
        pass


class CancelIgnored(Broken):
    """Takes cancel() and goes on."""

    caught_by = "goal.cancel"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        goal._cancel = not_cancelled


class CancelStopsAll(Broken):
    """Stops on any cancel(), whichever goal it names."""

    caught_by = "goal.cancel_own"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        cancel = goal._cancel

        def cancel_and_stop(any_goal: Goal) -> None:
            cancel(any_goal)
            self._halt()

        goal._cancel = cancel_and_stop


class EarlyArrival(Broken):
    """Believes the vehicle's own acceptance radius of 0.3 m."""

    caught_by = "goto.radius"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        goal.radius_sq_m2 = 0.3**2


class AcceptedIsReached(Broken):
    """Reports a goal that was accepted as reached."""

    caught_by = "goto.accepted_is_not_reached"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        goal._end(GoalStatus.REACHED, "accepted", self.clock.now())


class AnybodyDrives(Broken, overrides=("goto",)):
    """Executes gotos of whoever sends them."""

    caught_by = "goto.not_in_charge"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        goal = super().goto(target, self.in_charge)
        goal.by = by
        return goal


class RejectedIsExecuted(Broken, overrides=("goto",)):
    """Says REJECTED, and sends the goto all the same."""

    caught_by = "goto.not_in_charge"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        goal = super().goto(target, by)
        if goal.status is GoalStatus.REJECTED:
            self._mux.give(self.in_charge, goal, self._world.now_s)
        return goal


class Unchecked(Broken, overrides=("goto",)):
    """Lets any number through."""

    caught_by = "goto.invalid"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        if type(target) is Waypoint and not math.isfinite(target.x_m):
            target = target._replace(x_m=0.0)
        return super().goto(target, by)


class BlockingGoto(Broken, overrides=("goto",)):
    """Returns from goto() when the robot has moved off."""

    caught_by = "goto.returns_at_once"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        goal = super().goto(target, by)
        end_s = self.clock.now() + 0.3
        while goal.active and self.clock.now() < end_s:
            self.renew_lease()
            self.clock.sleep_until(self.clock.now() + 0.05)
            self.read_state()
        return goal


class BlockingRead(Broken, overrides=("read_state",)):
    """Waits for the next sample when the state is read."""

    caught_by = "state.never_waits"

    def read_state(self) -> RobotState:
        self.clock.sleep_until(self.clock.now() + 0.05)
        return super().read_state()


class SpeedCapIgnored(Broken):
    """Drives at its own speed whatever cap a goal has."""

    caught_by = "goto.speed_cap"

    def _send_goto(self, goal: Goal) -> None:
        goal.target = goal.target._replace(speed_m_s=None)
        super()._send_goto(goal)


class HeadingDropped(Broken):
    """Takes a heading to arrive with, and drops it."""

    caught_by = "goto.heading"

    def _send_goto(self, goal: Goal) -> None:
        goal.target = goal.target._replace(heading_rad=None)
        super()._send_goto(goal)


class QueueReplays(Broken):
    """Works off every target it was ever sent, in order."""

    caught_by = "goal.superseded"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._waiting: list[Goal] = []

    def _send_goto(self, goal: Goal) -> None:
        self._waiting.append(goal)

    def _hand_over(self, to: Controller) -> None:
        self._waiting.clear()
        super()._hand_over(to)

    def _halt(self) -> None:
        self._waiting.clear()
        super()._halt()

    def _sample(self) -> RobotState:
        state, now = self._honest(), self._mux.command
        arrived = now is None or math.hypot(now.target.x_m - state.x_m, now.target.y_m - state.y_m) < 0.02
        if arrived and self._waiting:
            goal = self._waiting.pop(0)
            self._mux.give(goal.by, goal, self._world.now_s)
        return state


class DriftsOn(Broken):
    """Creeps on after it has arrived, because the last set-point was a velocity."""

    caught_by = "goto.holds"

    def _connect(self, timeout_s: float) -> Capabilities:
        honest = self._vehicle.control

        def control(*state: float) -> tuple[float, float]:
            speed, rate = honest(*state)
            goal = self._mux.command
            return (0.03, 0.0) if speed == 0.0 and goal is not None and not goal.active else (speed, rate)

        found = super()._connect(timeout_s)
        self._world.set_control(self.id, control)
        return found


class AltitudeDropped(Broken, overrides=("goto",)):
    """Says that a goal above the ground is reached from the ground."""

    caught_by = "capabilities.unsupported"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        return super().goto(target._replace(z_m=0.0) if type(target) is Waypoint else target, by)


class WeakBrakes(Broken):
    """Brakes at a third of what it declares."""

    caught_by = "bounds.braking"
    declared: ClassVar[Capabilities] = replace(SimulatedRobot.declared, brake_m_s2=3.0, latency_s=0.0)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._drive_with(LIMITS)


class Curved(Broken):
    """Drives a curve where it declares a straight segment."""

    caught_by = "bounds.tube"

    def _connect(self, timeout_s: float) -> Capabilities:
        honest = self._vehicle.control

        def control(*state: float) -> tuple[float, float]:
            speed, rate = honest(*state)
            return speed, rate + (0.6 if speed > 0.1 else 0.0)

        found = super()._connect(timeout_s)
        self._world.set_control(self.id, control)
        return found


class FasterThanDeclared(Broken):
    """Declares less than its top speed and clamps nothing."""

    caught_by = "goto.v_max"
    declared: ClassVar[Capabilities] = replace(SimulatedRobot.declared, v_max_m_s=0.15)


class NoBody(Broken):
    """Declares that its body takes no room."""

    caught_by = "capabilities.sane"
    declared: ClassVar[Capabilities] = replace(SimulatedRobot.declared, body_radius_m=0.0)


def _wrapped(value: float, most: float) -> float:
    return (value + most) % (2.0 * most) - most


TARGETS: Final = (
    targeted("WrappedAt33", "Wraps targets at 33 m, as 16 bits of millimetres do.", "goto.far", "wrapped",
             lambda _, t: t._replace(x_m=_wrapped(t.x_m, 32.768), y_m=_wrapped(t.y_m, 32.768))),
    targeted("WrappedAt128", "Wraps targets at 128 m.", "goto.far", "wrapped",
             lambda _, t: t._replace(x_m=_wrapped(t.x_m, 128.0), y_m=_wrapped(t.y_m, 128.0))),
    targeted("UnsignedTargets", "Sends targets without their signs.", "goto.far", "sign",
             lambda _, t: t._replace(x_m=abs(t.x_m), y_m=abs(t.y_m))),
    targeted("CutOffAt100", "Cuts targets off at 100 m.", "goto.far", "cut off",
             lambda _, t: t._replace(x_m=max(-100.0, min(100.0, t.x_m)), y_m=max(-100.0, min(100.0, t.y_m)))),
    targeted("Decimetres", "Rounds targets to whole decimetres.", "goto.arrives", "stopped short",
             lambda _, t: t._replace(x_m=round(t.x_m, 1), y_m=round(t.y_m, 1))),
    targeted("SwappedTargets", "Swaps north and east of targets.", "state.frame", "axes|frame",
             lambda _, t: t._replace(x_m=t.y_m, y_m=t.x_m)),
    targeted("RelativeTargets", "Takes targets as ways from where it started.", "state.frame", "frame",
             lambda r, t: t._replace(x_m=t.x_m + r.spec.x_m, y_m=t.y_m + r.spec.y_m)),
    targeted("HeadingMirrored", "Sends headings clockwise.", "goto.heading", "sign|another frame",
             lambda _, t: t._replace(heading_rad=None if t.heading_rad is None else -t.heading_rad)),
    targeted("EastIsNone", "Takes a heading of exactly 0 for none.", "goto.heading", "taken for none",
             lambda _, t: t._replace(heading_rad=t.heading_rad or None)),
    targeted("OriginIsNone", "Takes coordinates of exactly 0 for none, and stays.", "goto.far", "0 is taken for none",
             lambda r, t: t if t.x_m and t.y_m else t._replace(x_m=r._honest().x_m, y_m=r._honest().y_m)),
    targeted("HeadingCutOff", "Cuts a heading off at pi, and does not wrap it.", "goto.heading", "wrap it",
             lambda _, t: t._replace(heading_rad=t.heading_rad and min(max(t.heading_rad, -math.pi), math.pi))),
    targeted("HeadingInDegrees", "Sends headings in degrees.", "goto.heading", "frame",
             lambda _, t: t._replace(heading_rad=None if t.heading_rad is None else math.degrees(t.heading_rad))),
    targeted("TwiceTheCap", "Sends twice the speed cap.", "goto.speed_cap", "speed_m_s",
             lambda _, t: t._replace(speed_m_s=None if t.speed_m_s is None else 2.0 * t.speed_m_s)),
    targeted("CapTenPercentHigh", "Drives 10 % faster than the cap.", "goto.speed_cap", "speed_m_s",
             lambda _, t: t._replace(speed_m_s=None if t.speed_m_s is None else 1.1 * t.speed_m_s)),
    targeted("CapStays", "Keeps to the cap of an earlier goal.", "goto.speed_cap", "come up",
             lambda r, t: t._replace(speed_m_s=min(memory(r, "caps", list).__iadd__([t.speed_m_s or 9.0])))),
    targeted("FiveCentimetresShort", "Stops 5 cm short of its target.", "goto.accepted_is_not_reached", "within",
             lambda r, t: t._replace(x_m=t.x_m - 0.055 * math.cos(r.spec.heading_rad),
                                     y_m=t.y_m - 0.055 * math.sin(r.spec.heading_rad))),
)  # fmt: skip

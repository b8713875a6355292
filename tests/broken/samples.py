"""Adapters in process that are wrong in what they say of a robot."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar, Final

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.sdk import Capabilities, Controller, RobotState
from tests.broken.edits import sampled
from tests.broken.in_process import Broken
from tests.broken.parts import (
    SECOND,
    ago,
    memory,
    once_in,
    scaled,
)


class NedForEnu(Broken):
    """Hands out north and east in the autopilot's order."""

    caught_by = "state.frame"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(x_m=state.y_m, y_m=state.x_m, vx_m_s=state.vy_m_s, vy_m_s=state.vx_m_s)


class YawSign(Broken):
    """Counts headings clockwise."""

    caught_by = "state.heading"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(heading_rad=-state.heading_rad, yaw_rate_rad_s=-state.yaw_rate_rad_s)


class Degrees(Broken):
    """Hands out headings in degrees."""

    caught_by = "state.ranges"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(heading_rad=math.degrees(state.heading_rad))


class Percent(Broken):
    """Hands out the charge in percent."""

    caught_by = "state.ranges"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(battery=100.0 * (state.battery or 0.0))


class BodyFrameVelocity(Broken):
    """Hands out the velocity along the body's axes."""

    caught_by = "state.velocity"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(vx_m_s=math.hypot(state.vx_m_s, state.vy_m_s), vy_m_s=0.0)


class LateSamples(Broken):
    """Hands out what was 0.4 s ago, stamped as of now."""

    caught_by = "bounds.latency"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._past: list[RobotState] = []

    def _sample(self) -> RobotState:
        state = self._honest()
        if not self._past or state.stamp_s > self._past[-1].stamp_s:
            self._past = [*self._past, state][-9:]
        old = self._past[0]
        return old._replace(stamp_s=state.stamp_s, vehicle_stamp_s=state.vehicle_stamp_s, controller=state.controller)


class AgeFrozen(Broken):
    """Takes a sample once a second and stamps it anew whenever it is read."""

    caught_by = "state.fresh"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._kept: RobotState | None = None

    def _sample(self) -> RobotState:
        state = self._honest()
        if self._kept is None or state.vehicle_stamp_s - self._kept.vehicle_stamp_s >= 1.0:
            self._kept = state
        return self._kept._replace(stamp_s=state.stamp_s, controller=state.controller, goal_id=state.goal_id)


class OldSamples(Broken):
    """Queues samples, so that a reader gets ones that are 0.3 s old, honestly stamped."""

    caught_by = "state.age"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._queue: list[RobotState] = []

    def _sample(self) -> RobotState:
        state = self._honest()
        if not self._queue or state.stamp_s > self._queue[-1].stamp_s:
            self._queue = [*self._queue, state][-7:]
        return self._queue[0]


class VehicleClockStands(Broken):
    """Passes on a vehicle stamp that never changes."""

    caught_by = "state.stamps"

    def _sample(self) -> RobotState:
        return self._honest()._replace(vehicle_stamp_s=0.0)


class FutureStamps(Broken):
    """Estimates the vehicle's clock to be ahead, and stamps samples in the future."""

    caught_by = "state.stamps"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(stamp_s=state.stamp_s + 0.09)


class MadeUpController(Broken):
    """Reports a controller although the vehicle does not: it declares otherwise."""

    caught_by = "capabilities.optional"
    declared: ClassVar[Capabilities] = replace(SimulatedRobot.declared, reports_controller=False)


class Unseeded(Broken):
    """Declares to be deterministic and adds noise from the operating system."""

    caught_by = "capabilities.deterministic"
    _noise: ClassVar[random.SystemRandom] = random.SystemRandom()

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(x_m=state.x_m + self._noise.uniform(-1e-6, 1e-6))


class OthersIds(Broken):
    """Takes the samples of whichever robot has sent last."""

    caught_by = "several.ids"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._index = len(self._world.bodies.ids) - 1


def _noise(robot: Any) -> random.Random:
    return memory(robot, "noise", lambda: random.Random(0))  # type: ignore[no-any-return]


def _unsigned(_: Any, state: RobotState) -> RobotState:
    v = math.hypot(state.vx_m_s, state.vy_m_s)
    return state._replace(vx_m_s=v * math.cos(state.heading_rad), vy_m_s=v * math.sin(state.heading_rad))


def _along_course(_: Any, state: RobotState) -> RobotState:
    moves = math.hypot(state.vx_m_s, state.vy_m_s) > 0.02
    return state._replace(heading_rad=math.atan2(state.vy_m_s, state.vx_m_s)) if moves else state


def _noisy(off_m: float) -> Callable[[Any, RobotState], RobotState]:
    def edit(robot: Any, state: RobotState) -> RobotState:
        draw = _noise(robot).uniform
        # One draw for each stamp: a sample that is read twice is the same.
        seen = memory(robot, "seen", dict)
        if state.stamp_s not in seen:
            seen.clear()
            seen[state.stamp_s] = draw(-off_m, off_m), draw(-off_m, off_m)
        dx, dy = seen[state.stamp_s]
        return state._replace(x_m=state.x_m + dx, y_m=state.y_m + dy)

    return edit


def _held_charge(step: float | None) -> Callable[[Any, RobotState], RobotState]:
    def edit(robot: Any, state: RobotState) -> RobotState:
        first = memory(robot, "charge", lambda: state.battery)
        return state._replace(battery=first if step is None else math.ceil((state.battery or 0.0) / step) * step)

    return edit


def _only_falls(robot: Any, state: RobotState) -> RobotState:
    least = memory(robot, "least", lambda: [1.0])
    least[0] = min(least[0], state.battery or 0.0)
    return state._replace(battery=least[0])


def _second(edit: Callable[[Any, RobotState], RobotState]) -> Callable[[Any, RobotState], RobotState]:
    return lambda robot, state: edit(robot, state) if robot.id == SECOND else state


def _frozen_after(seconds: float, *, stamped: bool) -> Callable[[Any, RobotState], RobotState]:
    def edit(robot: Any, state: RobotState) -> RobotState:
        last = memory(robot, "last", lambda: [state])
        if state.stamp_s <= seconds:
            last[0] = state
            return state
        if not stamped:
            return last[0]  # type: ignore[no-any-return]
        return last[0]._replace(  # type: ignore[no-any-return]
            stamp_s=state.stamp_s, vehicle_stamp_s=state.vehicle_stamp_s, controller=state.controller
        )

    return edit


def _stamped(edit: Callable[[float], float]) -> Callable[[Any, RobotState], RobotState]:
    return lambda _, state: state._replace(vehicle_stamp_s=edit(state.vehicle_stamp_s))


def _said(controller: Callable[[Any, RobotState], Controller | None]) -> Callable[[Any, RobotState], RobotState]:
    return lambda robot, state: state._replace(controller=controller(robot, state))


def _other(controller: Controller | None) -> Controller:
    return Controller.SC if controller is Controller.AC else Controller.AC


SAMPLES: Final = (
    sampled("SpeedUnsigned", "Says the speed without its sign when it reverses.", "state.backwards", "sign", _unsigned),
    sampled("HeadingIsCourse", "Takes the course over ground for the heading.", "state.backwards", "its course",
            _along_course),
    sampled("SpeedNinePercentLow", "Says a speed 9 % low.", "state.velocity", "too low", lambda _, s: scaled(s, 0.91)),
    sampled("SpeedNinePercentHigh", "Says a speed 9 % high.", "state.velocity", "unit", lambda _, s: scaled(s, 1.09)),
    sampled("SpeedInKnots", "Says speeds in knots.", "state.velocity", "unit|half of v_max", lambda _, s: scaled(s,
            1.944)),
    sampled("NoVelocity", "Says no velocity.", "state.velocity", "missing|come up", lambda _, s: scaled(s, 0.0)),
    sampled("VelocityFiltered", "Hands out velocities of half a second ago.", "truth.bounds.velocity", "late",
            lambda r, s: s._replace(**{k: getattr(ago(r, s, 10), k) for k in ("vx_m_s", "vy_m_s")})),
    sampled("VelocityMirrored", "Has the north velocity southwards.", "state.velocity", "frame",
            lambda _, s: s._replace(vy_m_s=-s.vy_m_s)),
    sampled("PositionsFiltered", "Smooths positions, which then lag.", "truth.bounds.noise", "noise",
            lambda r, s: s._replace(x_m=0.5 * (s.x_m + ago(r, s, 4).x_m), y_m=0.5 * (s.y_m + ago(r, s, 4).y_m))),
    sampled("PositionsPredicted", "Hands out where the robot will be in a tenth of a second.", "truth.bounds.noise",
            "position_noise_m", lambda _, s: s._replace(x_m=s.x_m + 0.1 * s.vx_m_s, y_m=s.y_m + 0.1 * s.vy_m_s)),
    sampled("RoamsAtRest", "Shows 0.05 m/s at rest.", "bounds.rest", "speed_noise_m_s",
            lambda _, s: s if math.hypot(s.vx_m_s, s.vy_m_s) > 0.01 else s._replace(vx_m_s=0.05)),
    sampled("TwoCentimetresOff", "Has positions scatter by 2 cm.", "truth.bounds.noise", "position_noise_m",
            _noisy(0.02)),
    sampled("OneCentimetreEast", "Is 1 cm off to the east, always.", "truth.bounds.noise", "position_noise_m",
            lambda _, s: s._replace(x_m=s.x_m + 0.01)),
    sampled("OnePercentTooFar", "Counts wheels that are 1 % too small.", "truth.bounds.noise", "position_noise_m",
            lambda _, s: s._replace(x_m=1.01 * s.x_m, y_m=1.01 * s.y_m)),
    sampled("Feet", "Hands out feet.", "state.start", "unit", lambda _, s: s._replace(x_m=3.28 * s.x_m,
            y_m=3.28 * s.y_m)),
    sampled("MirroredEast", "Counts west for east.", "state.start", "mirrored", lambda _, s: s._replace(x_m=-s.x_m)),
    sampled("MirroredNorth", "Counts south for north, from where it starts.", "state.frame", "mirrored",
            lambda r, s: s._replace(y_m=2.0 * r.spec.y_m - s.y_m)),
    sampled("OwnOrigin", "Counts from where it starts.", "state.start", "origin",
            lambda r, s: s._replace(x_m=s.x_m - r.spec.x_m, y_m=s.y_m - r.spec.y_m)),
    sampled("TurnSign", "Counts turn rates clockwise.", "state.yaw_rate", "sign",
            lambda _, s: s._replace(yaw_rate_rad_s=-s.yaw_rate_rad_s)),
    sampled("TurnDegrees", "Says turn rates in degrees.", "state.yaw_rate", "degrees",
            lambda _, s: s._replace(yaw_rate_rad_s=math.degrees(s.yaw_rate_rad_s))),
    sampled("NoTurn", "Says no turn rate.", "state.yaw_rate", "yaw rates", lambda _, s: s._replace(yaw_rate_rad_s=0.0)),
    sampled("TurnUnsigned", "Says turn rates without their sign.", "state.yaw_rate", "to the right",
            lambda _, s: s._replace(yaw_rate_rad_s=abs(s.yaw_rate_rad_s))),
    sampled("TurnTooLow", "Says turn rates 15 % low.", "state.yaw_rate", "too low",
            lambda _, s: s._replace(yaw_rate_rad_s=0.85 * s.yaw_rate_rad_s)),
    sampled("HeadingNotWrapped", "Counts headings from 0 to 2 pi.", "state.ranges", "not wrapped",
            lambda _, s: s._replace(heading_rad=s.heading_rad % (2.0 * math.pi))),
    sampled("Compass", "Counts headings clockwise from north.", "state.start", "compass",
            lambda _, s: s._replace(heading_rad=math.remainder(math.pi / 2.0 - s.heading_rad, 2.0 * math.pi))),
    sampled("HeadingTenthOff", "Has a compass that is 0.1 rad off.", "truth.bounds.noise", "heading",
            lambda _, s: s._replace(heading_rad=math.remainder(s.heading_rad + 0.1, 2.0 * math.pi))),
    sampled("NaNOnceInThousand", "Hands out NaN once in a thousand samples.", "state.ranges", "not finite",
            once_in(1000, x_m=math.nan)),
    sampled("InfiniteTurnOnce", "Hands out an infinite turn rate once in a thousand samples.", "state.ranges",
            "not finite", once_in(1000, yaw_rate_rad_s=math.inf)),
    sampled("ChargeAboveOneOnce", "Hands out a charge of 1.01 once in a thousand samples.", "state.ranges", "discarded",
            once_in(1000, battery=1.01)),
    sampled("OthersSampleOnce", "Hands out robot 9's sample once in a thousand.", "state.ranges", "another robot",
            once_in(1000, robot_id=9)),
    sampled("ChargeFrozen", "Freezes the charge at its first value.", "state.charge", "frozen", _held_charge(None)),
    sampled("ChargeInTenths", "Says the charge in steps of a tenth.", "state.charge", "frozen|fell by more",
            _held_charge(0.1)),
    sampled("ChargeOnlyFalls", "Never lets the charge rise again.", "state.charge", "on its charger", _only_falls),
    sampled("ChargeFalls", "Has the charge fall far too fast.", "state.charge", "fell by more",
            lambda r, s: s._replace(battery=max(0.0, (s.battery or 0.0) - 0.01 * s.stamp_s))),
    sampled("NoCharge", "Declares to report its charge, and does not.", "capabilities.optional", "reports_battery",
            lambda _, s: s._replace(battery=None)),
    sampled("FirstGoalForEver", "Names the first goal for ever.", "goal.ids", "goal",
            lambda r, s: s._replace(goal_id=1)),
    sampled("OwnGoalNumbers", "Names goals by the vehicle's own count.", "goal.ids", "count",
            lambda _, s: s._replace(goal_id=None if s.goal_id is None else 1000 + s.goal_id)),
    sampled("AlwaysAc", "Reports the AC in charge, always.", "lifecycle.init", "in charge", _said(lambda _,
            s: Controller.AC)),
    sampled("Swapped", "Reports the SC for the AC and the other way round.", "authority.confirmed", "report",
            _said(lambda _, s: _other(s.controller))),
    sampled("StopsReporting", "Reports no controller any more after a second.", "authority.confirmed", "reported",
            _said(lambda _, s: s.controller if s.stamp_s < 1.0 else None)),
    sampled("Milliseconds", "Passes on the vehicle's milliseconds.", "state.stamps", "milliseconds",
            _stamped(lambda at_s: 1000.0 * at_s)),
    sampled("ClockOnePercentFast", "Has a vehicle clock that is 1 % fast.", "state.stamps", "fast or slow",
            _stamped(lambda at_s: 1.01 * at_s)),
    sampled("ClockOnePercentSlow", "Has a vehicle clock that is 1 % slow.", "state.stamps", "fast or slow",
            _stamped(lambda at_s: 0.99 * at_s)),
    sampled("WholeSeconds", "Stamps samples in whole seconds.", "state.age", "sample_age_s",
            lambda _, s: s._replace(stamp_s=math.floor(s.stamp_s + 1e-9))),
    sampled("FrozenRestamped", "Freezes after 3 s, and stamps the last sample anew.", "state.frame",
            "frozen|all of one",
            _frozen_after(3.0, stamped=True)),
    sampled("DeadAfterThreeSeconds", "Is not heard any more after 3 s.", "state.frame", "nothing has been heard",
            _frozen_after(3.0, stamped=False)),
    sampled("SecondTurnSign", "Counts turn rates of the second robot clockwise.", "several.second", "sign",
            _second(lambda _, s: s._replace(yaw_rate_rad_s=-s.yaw_rate_rad_s))),
    sampled("SecondMirrored", "Counts south for north for the second robot.", "several.second", "mirrored",
            _second(lambda r, s: s._replace(y_m=2.0 * r.spec.y_m - s.y_m))),
    sampled("SecondOld", "Queues samples of the second robot.", "several.second", "queue",
            _second(lambda r, s: ago(r, s, 6))),
)  # fmt: skip

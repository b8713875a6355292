"""Small edits of the reference adapter, one line of a table each, where a class would say no more."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

from soter.adapters.pybullet.backend import KinematicRobot
from soter.clock import VirtualClock
from soter.conformance.find import open_floor
from soter.errors import SoterError
from soter.sdk import Controller, GoalStatus, RobotState, Waypoint
from soter_sim import LIMITS
from tests.broken.edits import edited, promising, sampled, targeted
from tests.broken.in_process import Broken

FIRST, SECOND, THIRD = (place.id for place in open_floor().robots)


class Exact(Broken):
    """Promises its acceleration, and exact velocities and headings; the base of what does not keep that."""

    caught_by = ""
    declared = KinematicRobot.declared


def _of(robot: Any, name: str, made: Callable[[], Any]) -> Any:
    """Return something that a robot keeps for an edit."""
    kept: dict[str, Any] = robot.__dict__.setdefault("kept", {})
    if name not in kept:
        kept[name] = made()
    return kept[name]


def _count(robot: Any, name: str = "count") -> int:
    counts = _of(robot, name, lambda: [0])
    counts[0] += 1
    return int(counts[0])


def _noise(robot: Any) -> random.Random:
    return _of(robot, "noise", lambda: random.Random(0))  # type: ignore[no-any-return]


def _ago(robot: Any, state: RobotState, samples: int) -> RobotState:
    """Return the sample of so many samples ago."""
    past = _of(robot, "past", list)
    if not past or state.stamp_s > past[-1].stamp_s:
        past.append(state)
        del past[: -samples - 1]
    return past[0]  # type: ignore[no-any-return]


def _scaled(state: RobotState, by: float) -> RobotState:
    return state._replace(vx_m_s=by * state.vx_m_s, vy_m_s=by * state.vy_m_s)


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
        seen = _of(robot, "seen", dict)
        if state.stamp_s not in seen:
            seen.clear()
            seen[state.stamp_s] = draw(-off_m, off_m), draw(-off_m, off_m)
        dx, dy = seen[state.stamp_s]
        return state._replace(x_m=state.x_m + dx, y_m=state.y_m + dy)

    return edit


def _once_in(many: int, **bad: float) -> Callable[[Any, RobotState], RobotState]:
    return lambda robot, state: state._replace(**bad) if _count(robot) % many == 0 else state  # type: ignore[arg-type]


def _held_charge(step: float | None) -> Callable[[Any, RobotState], RobotState]:
    def edit(robot: Any, state: RobotState) -> RobotState:
        first = _of(robot, "charge", lambda: state.battery)
        return state._replace(battery=first if step is None else math.ceil((state.battery or 0.0) / step) * step)

    return edit


def _only_falls(robot: Any, state: RobotState) -> RobotState:
    least = _of(robot, "least", lambda: [1.0])
    least[0] = min(least[0], state.battery or 0.0)
    return state._replace(battery=least[0])


def _second(edit: Callable[[Any, RobotState], RobotState]) -> Callable[[Any, RobotState], RobotState]:
    return lambda robot, state: edit(robot, state) if robot.id == SECOND else state


def _frozen_after(seconds: float, *, stamped: bool) -> Callable[[Any, RobotState], RobotState]:
    def edit(robot: Any, state: RobotState) -> RobotState:
        last = _of(robot, "last", lambda: [state])
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


def _wrapped(value: float, most: float) -> float:
    return (value + most) % (2.0 * most) - most


def _with_control(
    edit: Callable[[Any, tuple[float, ...], float, float], tuple[float, float]],
) -> Callable[[Any, float], Any]:
    """Return a `_connect` after which the vehicle's own control is edited: robot, state, speed, turn rate."""

    def connect(self: Any, timeout_s: float) -> Any:
        honest = self._vehicle.control
        found = Broken._connect(self, timeout_s)
        self._world.set_control(self.id, lambda *state: edit(self, state, *honest(*state)))
        return found

    return connect


def _limited(**limits: float) -> Callable[..., None]:
    """Return a constructor of a robot whose vehicle can do something else."""

    def begin(self: Any, *arguments: Any) -> None:
        Broken.__init__(self, *arguments)
        self._drive_with(replace(LIMITS, **limits))

    return begin


def _leased(seconds: float, robot_id: int | None = None) -> Callable[..., None]:
    def begin(self: Any, *arguments: Any) -> None:
        Broken.__init__(self, *arguments)
        if robot_id in (None, self.id):
            self._mux.lease_s = seconds

    return begin


def _braking_at(share: float) -> Callable[[Any, tuple[float, ...], float, float], tuple[float, float]]:
    """Return a control that lets the speed fall no faster than this share of the promise."""

    def edit(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
        slowest = abs(state[4]) - share * LIMITS.brake_m_s2 * robot._world.period_s
        return (math.copysign(max(abs(speed), slowest), state[4]) if abs(speed) < slowest else speed), rate

    return edit


def _late(periods: int, *, gotos: bool = True, halts: bool = True, every: int = 1) -> dict[str, Callable[..., None]]:
    """Return hooks that act so many periods later."""

    def later(self: Any, act: Callable[[], object]) -> None:
        _of(self, "due", list).append((self._world.now_s + periods * self._world.period_s, act))

    def send(self: Any, goal: Any) -> None:
        if gotos and _count(self, "sent") % every == 0:
            later(self, lambda: self._mux.give(goal.by, goal, self._world.now_s))
        else:
            Broken._send_goto(self, goal)

    def halt(self: Any) -> None:
        if halts and _count(self, "halted") % every == 0:
            later(self, self._mux.halt)
        else:
            Broken._halt(self)

    def connect(self: Any, timeout_s: float) -> Any:
        honest = self._vehicle.control
        found = Broken._connect(self, timeout_s)

        def control(*state: float) -> Any:
            due = _of(self, "due", list)
            while due and due[0][0] <= state[0] + 1e-6:
                due.pop(0)[1]()
            return honest(*state)

        self._world.set_control(self.id, control)
        return found

    return {"_send_goto": send, "_halt": halt, "_connect": connect}


def _calls_also(name: str, also: Callable[[Any], object]) -> Callable[..., None]:
    """Return a hook that does one thing more."""

    def call(self: Any, *arguments: Any) -> None:
        getattr(Broken, name)(self, *arguments)
        also(self)

    return call


def _hand_over_lost(every: int, *, reported: bool) -> dict[str, Callable[..., Any]]:
    """Return hooks that lose one hand-over of so many, once robots are ready."""

    def hand_over(self: Any, to: Controller) -> None:
        if _count(self, "handed") % every:
            Broken._hand_over(self, to)
            _of(self, "said", lambda: [to])[0] = to
        elif reported:
            self._mux.in_charge = to

    return {"_hand_over": hand_over}


def _switched_late(seconds: float) -> dict[str, Callable[..., Any]]:
    """Return hooks that report a hand-over at once, and let the old target live on for a while."""

    def hand_over(self: Any, to: Controller) -> None:
        old = self._mux.command
        Broken._hand_over(self, to)
        if old is not None:
            self._mux.command = old
            _of(self, "ends", lambda: [0.0, None])[:] = [self._world.now_s + seconds, old]

    def edit(self: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
        ends_s, old = _of(self, "ends", lambda: [math.inf, None])
        if state[0] + 1e-6 >= ends_s and self._mux.command is old:
            self._mux.command = None
            return 0.0, 0.0
        return speed, rate

    return {"_hand_over": hand_over, "_connect": _with_control(edit)}


def _renews(self: Any) -> None:
    self._mux.renew(self._world.now_s)


def _says_failed(self: Any, *arguments: Any) -> Any:
    found = Broken.read_state(self, *arguments)
    for goal in _of(self, "sent", list):
        goal.status = GoalStatus.FAILED if goal.status is GoalStatus.TIMED_OUT else goal.status
    return found


def _remembers(self: Any, goal: Any) -> None:
    _of(self, "sent", list).append(goal)
    Broken._send_goto(self, goal)


def _reads(self: Any) -> None:
    with suppress(SoterError):
        self.read_state()


def _raise(robot: Any) -> None:
    raise RuntimeError(f"robot {robot.id} was closed already")


def _forgets_its_goal(robot: Any, timeout_s: float) -> None:
    robot._Robot__goal = None
    Broken.close(robot, timeout_s)


def _coasting(self: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    if self._mux.command is not None and self._mux.passing(state[0]) is None:
        slowest = abs(state[4]) - 0.3 * self._world.period_s
        speed = math.copysign(max(abs(speed), slowest), state[4]) if slowest > abs(speed) else speed
    return speed, rate


def _at_the_edge(robot: Any, target: Waypoint) -> Waypoint:
    at = robot._honest()
    dx, dy = target.x_m - at.x_m, target.y_m - at.y_m
    share = max(target.radius_m - 0.005, 0.0) / max(math.hypot(dx, dy), 0.01)
    return target._replace(x_m=target.x_m - share * dx, y_m=target.y_m - share * dy)


def _few_gotos(self: Any, goal: Any) -> None:
    if _count(self, "gotos") < 150:
        Broken._send_goto(self, goal)


def _stops_forwards(self: Any) -> None:
    if self._v[self._index] > -0.05:
        Broken._halt(self)


_DEAF_S: Final = 0.2


def _deafens(self: Any, to: Controller) -> None:
    Broken._hand_over(self, to)
    self.deaf_s = self._world.now_s + _DEAF_S


def _deaf_control(self: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    return (0.0, 0.0) if state[0] < getattr(self, "deaf_s", 0.0) else (speed, rate)


SAMPLES: Final = (
    sampled("SpeedUnsigned", "Says the speed without its sign when it reverses.", "state.backwards", "sign", _unsigned),
    sampled("HeadingIsCourse", "Takes the course over ground for the heading.", "state.backwards", "its course",
            _along_course),
    sampled("SpeedNinePercentLow", "Says a speed 9 % low.", "state.velocity", "too low", lambda _, s: _scaled(s, 0.91)),
    sampled("SpeedNinePercentHigh", "Says a speed 9 % high.", "state.velocity", "unit", lambda _, s: _scaled(s, 1.09)),
    sampled("SpeedInKnots", "Says speeds in knots.", "state.velocity", "unit|half of v_max", lambda _, s: _scaled(s,
            1.944)),
    sampled("NoVelocity", "Says no velocity.", "state.velocity", "missing|come up", lambda _, s: _scaled(s, 0.0)),
    sampled("VelocityFiltered", "Hands out velocities of half a second ago.", "truth.bounds.velocity", "late",
            lambda r, s: s._replace(**{k: getattr(_ago(r, s, 10), k) for k in ("vx_m_s", "vy_m_s")})),
    sampled("VelocityMirrored", "Has the north velocity southwards.", "state.velocity", "frame",
            lambda _, s: s._replace(vy_m_s=-s.vy_m_s)),
    sampled("PositionsFiltered", "Smooths positions, which then lag.", "truth.bounds.noise", "noise",
            lambda r, s: s._replace(x_m=0.5 * (s.x_m + _ago(r, s, 4).x_m), y_m=0.5 * (s.y_m + _ago(r, s, 4).y_m))),
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
            _once_in(1000, x_m=math.nan)),
    sampled("InfiniteTurnOnce", "Hands out an infinite turn rate once in a thousand samples.", "state.ranges",
            "not finite", _once_in(1000, yaw_rate_rad_s=math.inf)),
    sampled("ChargeAboveOneOnce", "Hands out a charge of 1.01 once in a thousand samples.", "state.ranges", "discarded",
            _once_in(1000, battery=1.01)),
    sampled("OthersSampleOnce", "Hands out robot 9's sample once in a thousand.", "state.ranges", "another robot",
            _once_in(1000, robot_id=9)),
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
            _second(lambda r, s: _ago(r, s, 6))),
)  # fmt: skip

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
             lambda r, t: t._replace(speed_m_s=min(_of(r, "caps", list).__iadd__([t.speed_m_s or 9.0])))),
    targeted("FiveCentimetresShort", "Stops 5 cm short of its target.", "goto.accepted_is_not_reached", "within",
             lambda r, t: t._replace(x_m=t.x_m - 0.055 * math.cos(r.spec.heading_rad),
                                     y_m=t.y_m - 0.055 * math.sin(r.spec.heading_rad))),
)  # fmt: skip


class FollowsTheHost(VirtualClock):
    """Goes on while nobody sleeps."""

    def now(self) -> float:
        return super().now() + 1e-3 * self.steady_s()


PROMISES: Final = (
    edited("HostTime", "Promises virtual time, and follows the host's.", "bounds.clock", "virtual time",
           clock_class=FollowsTheHost),
    promising(Broken, "BrakeTenPercent", "Promises brakes that are 10 % better.", "bounds.braking", "brake_m_s2",
            brake_m_s2=1.1),
    promising(Broken, "TopSpeedTenPercent", "Promises a top speed that is 10 % lower.", "goto.v_max", "v_max_m_s",
              v_max_m_s=0.2),
    promising(Broken, "TurnTenPercent", "Promises turns that are 10 % slower.", "bounds.yaw_rate", "yaw_rate_max",
              yaw_rate_max_rad_s=2.58),
    promising(Broken, "BodyTenPercent", "Promises a body that is 10 % smaller.", "truth.bounds.body", "body_radius_m",
              body_radius_m=0.095),
    promising(Exact, "OvershootTenPercent", "Promises to run on less than it does.", "bounds.overshoot",
            "brakes too late",
              overshoot_m=0.001),
    promising(Exact, "AccelerationTenPercent", "Promises to gain speed 10 % more slowly.", "bounds.acceleration",
              "accel_m_s2", accel_m_s2=0.9),
    promising(Exact, "AccelerationUnknown", "Promises an acceleration of 0.02, and has 1.", "bounds.acceleration",
              "accel_m_s2", accel_m_s2=0.02),
    promising(Broken, "TooFast", "Promises twice the top speed that it has.", "bounds.braking", "v_max_m_s",
            v_max_m_s=0.44),
    promising(Broken, "NoSamples", "Promises no battery, and reports one.", "capabilities.optional", "battery",
              reports_battery=False),
    edited("SpeedThreePercentLow", "Says a speed 3 % low, and promises exact ones.", "truth.bounds.velocity",
           "speed_noise_m_s", declared=Exact.declared, _sample=lambda self: _scaled(self._honest(), 0.97)),
    edited("HeadingHundredthOff", "Has headings 0.01 rad off, and promises exact ones.", "truth.bounds.noise",
           "heading_noise_rad", declared=Exact.declared,
           _sample=lambda self: (s := self._honest())._replace(heading_rad=math.remainder(s.heading_rad + 0.01,
            6.2831853))),
    edited("NoiseTenPercent", "Has 10 % more noise than promised.", "truth.bounds.noise", "position_noise_m",
           declared=replace(Broken.declared, position_noise_m=0.01),
           _sample=lambda self: (s := self._honest())._replace(x_m=s.x_m + 0.0112)),
    edited("AgeTenPercent", "Has samples 10 % older than promised.", "state.age", "sample_age_s",
           declared=replace(Broken.declared, sample_age_s=0.09), _sample=lambda self: _ago(self, self._honest(), 2)),
    targeted("CannotReverse", "Promises to reverse, and turns round.", "state.backwards", "cannot reverse",
             lambda _, t: t._replace(heading_rad=None)),
    edited("BrakesNinety", "Brakes at 90 % of what it promises.", "bounds.braking", "brake_m_s2",
           _connect=_with_control(_braking_at(0.9))),
    edited("BrakesSeventy", "Brakes at 70 % of what it promises, and promises a latency that it does not need.",
           "bounds.braking", "brake_m_s2", declared=replace(Broken.declared, latency_s=0.2),
           _connect=_with_control(_braking_at(0.7))),
    edited("BrakesFiftyFive", "Brakes at 55 % of what it promises.", "bounds.braking", "brake_m_s2",
           _connect=_with_control(_braking_at(0.55))),
    edited("ArcsFirst", "Promises to turn in place, and drives while it turns.", "bounds.pivot", "drives off",
           _connect=_with_control(lambda _, state, v, w: (0.1 if abs(w) > 0.5 else v, w))),
    edited("TubeBySteering", "Steers a little to the left all the time.", "bounds.tube", "curve",
           _connect=_with_control(lambda _, state, v, w: (v, w + (0.35 if abs(v) > 0.1 else 0.0)))),
    edited("LeaseTenPercent", "Has a lease 10 % longer than promised.", "deadman.lease", "lease_s is",
           __init__=_leased(0.15), declared=replace(Broken.declared, lease_s=0.136)),
    edited("LeaseTwice", "Has a lease twice as long as promised.", "deadman.lease", "lease_s is",
           __init__=_leased(0.2)),
    edited("LeaseTwiceOfSecond", "Has a lease three times as long for the second robot.", "several.second",
           "lease_s is", __init__=_leased(0.3, robot_id=SECOND)),
    edited("LatencyTenPercent", "Acts 10 % later than promised.", "bounds.latency", "latency_s",
           declared=replace(Broken.declared, latency_s=0.09), **_late(2)),
    edited("LateGotos", "Acts on a goto 0.1 s late.", "bounds.latency", "latency_s", **_late(2, halts=False)),
    edited("LateStops", "Acts on a stop 0.1 s late.", "bounds.latency", "latency_s", **_late(2, gotos=False)),
    edited("OneInFiveLate", "Acts on one command in five 0.1 s late.", "bounds.latency", "latency_s", **_late(2,
            every=5)),
    edited("OneInFifteenLate", "Acts on one command in fifteen 0.2 s late.", "bounds.latency", "latency_worst_s",
           **_late(4, every=15)),
)  # fmt: skip


def _indexed(index: Callable[[int, int], int]) -> Callable[..., None]:
    """Return an `__init__` by which a robot's place in the list comes of its id and how many there are."""

    def begin(self: Any, *arguments: Any) -> None:
        Broken.__init__(self, *arguments)
        self._index = index(self.id, len(self._v))

    return begin


def _flushes_again(self: Any, to: Controller) -> None:
    self._mux.halt()
    Broken._hand_over(self, to)


def _smoothed(robot: Any, state: RobotState) -> RobotState:
    """Return a sample with a charge that follows the real one in a minute."""
    kept = _of(robot, "charge", lambda: [state.battery, state.stamp_s])
    kept[0] += (state.battery - kept[0]) * min((state.stamp_s - kept[1]) / 60.0, 1.0)
    kept[1] = state.stamp_s
    return state._replace(battery=kept[0])


def _resting(robot: Any, state: RobotState) -> RobotState:
    """Return the last sample again, but for twice a second, once it has rested for 3 s."""
    kept = _of(robot, "resting", lambda: [state, state.stamp_s])
    if math.hypot(state.vx_m_s, state.vy_m_s) > 1e-3 or abs(state.yaw_rate_rad_s) > 1e-3:
        kept[1] = state.stamp_s
    elif state.stamp_s - kept[1] > 3.0 and state.stamp_s - kept[0].stamp_s < 0.5:
        return kept[0]  # type: ignore[no-any-return]
    kept[0] = state
    return state


def _one_behind(robot: Any, state: RobotState) -> RobotState:
    """Return the sample that was due at the read before."""
    kept = _of(robot, "behind", lambda: [state, state])
    if state is not kept[1]:
        kept[:] = kept[1], state
    return kept[0]  # type: ignore[no-any-return]


DUTIES: Final = (
    edited("IndexByNumber", "Takes a robot's number for its place in the list.", "several.ids",
           "another robot's", __init__=_indexed(lambda number, many: (number - 1) % many)),
    edited("IndexFromOne", "Takes a robot's number for its place in the list, and has no such place.", "lifecycle.init",
           "id taken for an index", __init__=_indexed(lambda number, _: number - 1)),
    edited("FlushedAgain", "Flushes the goal of the controller in charge when its hand-over is sent again.",
           "authority.idempotent", "that one's own goal", _hand_over=_flushes_again),
    sampled("ChargeSmoothed", "Follows the charge in a minute.", "several.charge", "lags behind", _smoothed),
    sampled("FirstOld", "Queues samples of the first of two robots.", "several.second", f"of robot {FIRST} queue",
            lambda r, s: _ago(r, s, 6) if r.id == FIRST and len(r._v) > 1 else s),
    sampled("OldAtRest", "Reports twice a second after 3 s of rest.", "authority.alternations", "report is old",
            _resting),
    sampled("OneBehind", "Hands out the sample that was due at the read before.", "goal.written_in_read_state",
            "at the one before", _one_behind),
    edited("CoastsOnLease", "Coasts when its lease ends, and brakes well at a cancel.", "deadman.lease", "lease|brake",
           _connect=_with_control(_coasting)),
    edited("OthersCharge", "Reports the first robot's charge for the second.", "several.charge", "charge of the other",
           _sample=lambda self: self._honest()._replace(battery=self._world.bodies.charge[0])),
    sampled("HeadingLags", "Hands out headings of 0.3 s ago.", "truth.bounds.noise", "heading",
            lambda r, s: s._replace(heading_rad=_ago(r, s, 6).heading_rad)),
    sampled("TurnLags", "Hands out turn rates of 0.4 s ago.", "state.yaw_rate", "too low",
            lambda r, s: s._replace(yaw_rate_rad_s=_ago(r, s, 8).yaw_rate_rad_s)),
    sampled("GridOfFive", "Rounds positions to 5 cm.", "truth.bounds.noise", "position_noise_m",
            lambda _, s: s._replace(x_m=round(20.0 * s.x_m) / 20.0, y_m=round(20.0 * s.y_m) / 20.0)),
    targeted("StopsAtTheEdge", "Stops at the edge of a goal's radius.", "goto.holds",
           "edge of the radius", _at_the_edge),
    edited("FewGotos", "Takes 150 gotos and no more.", "goto.flood", "older target|right way", _send_goto=_few_gotos),
    edited("StopsForwards", "Stops only while it drives forwards.", "goal.cancel", "backwards", _halt=_stops_forwards),
    edited("DeafAfterSwitch", "Does nothing for 0.2 s after a switch.", "authority.obeys_at_once", "deaf",
           _hand_over=_deafens, _connect=_with_control(_deaf_control)),
    edited("SlowToTheLeft", "Turns to the left at half its rate.", "bounds.yaw_rate", "to one side",
           _connect=_with_control(lambda _, state, v, w: (v, 0.5 * w if w > 0.0 else w))),
    edited("Creeps", "Creeps at 4 mm/s where it should rest.", "goto.holds", "creeps",
           _connect=_with_control(lambda _, state, v, w: (0.004 if v == 0.0 and abs(w) < 0.01 else v, w))),
    edited("CancelRenews", "Renews the lease with a cancel.", "deadman.cancel", "cancel", _halt=_calls_also("_halt",
            _renews)),
    edited("HandOverRenews", "Renews the lease with a hand-over.", "deadman.hand_over", "_hand_over",
           _hand_over=_calls_also("_hand_over", _renews)),
    edited("OneHandOverInFifty", "Loses one hand-over in fifty.", "authority.alternations", "lost",
            **_hand_over_lost(50, reported=False)),
    edited("OneFlushInFifty", "Reports every hand-over, and one in fifty flushes nothing.", "authority.effective",
            "lost",
           **_hand_over_lost(51, reported=True)),
    edited("AcknowledgedEarly", "Reports a hand-over 0.15 s before it is effective, within its latency.",
           "authority.effective", "reported before", declared=replace(Broken.declared, latency_s=0.17),
            **_switched_late(0.15)),
    edited("HandOverTenthLate", "Hands over 0.1 s late, and says so at once.", "authority.effective", "latency",
           **_switched_late(0.1)),
    edited("FlushesOneWay", "Flushes when the AC takes over only.", "authority.flushes", "old controller",
           _hand_over=lambda self, to: Broken._hand_over(self, to) if to is Controller.AC else setattr(self._mux,
            "in_charge", to)),
    edited("CancelStopsBoth", "Stops every robot with any cancel.", "several.cancel", "broadcast",
           _all=[], _connect=lambda self, timeout_s: (self._all.append(self), Broken._connect(self, timeout_s))[1],
           _halt=lambda self: [each._mux.halt() for each in self._all if each._world is self._world]),
    edited("TimesOutFailed", "Says FAILED for timed out.", "goal.timeout", "time-out", read_state=_says_failed,
           _send_goto=_remembers),
    edited("StartsWithAc", "Begins with the AC in charge.", "lifecycle.init", "in charge",
           _hand_over=lambda self, to: self._mux.switch(to if _count(self, "handed") > 1 else Controller.AC)),
    edited("InitTwice", "Takes a second init().", "lifecycle.init_twice", "raised nothing",
           init=lambda self, timeout_s: None if _count(self, "inits") > 1 else Broken.init(self, timeout_s)),
    edited("CloseRaises", "Raises when it is closed a second time.", "lifecycle.close_twice", "closed",
           close=lambda self, timeout_s: _raise(self) if _count(self, "closes") > 1 else Broken.close(self, timeout_s)),
    edited("LivesOn", "Still takes gotos after close().", "lifecycle.after_close", "raised nothing",
           _Robot__require_ready=lambda self, call: None),
    edited("GoalsLiveOn", "Leaves its goal active when it is closed.", "lifecycle.close_ends_goals", "close",
           close=_forgets_its_goal),
    edited("JudgedOnRenewal", "Judges goals when the lease is renewed.", "goal.written_in_read_state",
            "besides read_state",
           _renew_lease=_calls_also("_renew_lease", _reads)),
)  # fmt: skip


MUTANTS: Final = (*SAMPLES, *TARGETS, *PROMISES, *DUTIES)

"""Adapters that are right in the middle and wrong in a corner: of robots, of a life cycle, of what is asked for."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable
from typing import Any, Final

from soter.onboard.mux import Mux
from soter.sdk import Controller, Goal, RobotState, RuleLimits, Waypoint
from tests.broken.edits import edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import THIRD, leased, memory, with_control
from tests.broken.seldom import State
from tests.conformance.wire import Intent, Vehicle, WireRobot

_NEAR_M: Final = 0.15
_MICROSECONDS_S: Final = 2**32 / 1e6
_MILLISECONDS_S: Final = 2**32 / 1e3


class _MinuteMux(Mux[Controller, Goal]):
    """Counts a lease by the seconds of a minute."""

    def alive(self, now_s: float) -> bool:
        return super().alive(now_s) or (
            self._renewed_s > -math.inf and now_s % 60.0 - self._renewed_s % 60.0 < self.lease_s - 1e-6
        )


def _by_the_minute(robot: Any, *arguments: Any) -> None:
    Broken.__init__(robot, *arguments)
    robot._vehicle.mux = robot._mux = _MinuteMux(Controller.SC, robot._mux.lease_s)


def _docks(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """End what was begun once the target is near."""
    goal = robot._mux.command
    left_m = math.inf if goal is None else math.dist((goal.target.x_m, goal.target.y_m), state[1:3])
    ends = robot._mux.passing(state[0]) is None and 0.02 < left_m < _NEAR_M
    return (min(0.2, left_m), 0.0) if ends else (speed, rate)


_KEPT: Final[dict[int, Goal]] = {}


def _takes_up(robot: Any, *arguments: Any) -> None:
    Broken.__init__(robot, *arguments)
    if robot.id in _KEPT:
        robot._mux.give(Controller.SC, _KEPT.pop(robot.id), 0.0)


def _keeps(robot: Any, timeout_s: float) -> None:
    if robot._mux.in_charge is Controller.SC and robot._mux.command is not None:
        _KEPT[robot.id] = robot._mux.command
    Broken._disconnect(robot, timeout_s)


def _halts_ac(robot: Any) -> None:
    if robot._mux.in_charge is Controller.AC:
        Broken._halt(robot)


def _once_a_period(robot: Any, to: Controller) -> None:
    """Look at who is in charge once a period: to and fro in between is no change."""
    mux, now_s = robot._mux, robot._world.now_s
    before = memory(robot, "before", lambda: [now_s, mux.in_charge, mux.command])
    if before[0] != now_s:
        before[:] = now_s, mux.in_charge, mux.command
    Broken._hand_over(robot, to)
    if to is before[1]:
        mux.command = before[2]


def _flushes_what_moves(robot: Any, to: Controller) -> None:
    kept = robot._mux.command
    Broken._hand_over(robot, to)
    if robot._v[robot._index] == robot._yaw_rate[robot._index] == 0.0:
        robot._mux.command = kept


def _halts_what_moves(robot: Any) -> None:
    if robot._v[robot._index] != 0.0 or robot._yaw_rate[robot._index] != 0.0:
        Broken._halt(robot)


def _alive_only(act: Callable[[Any], None]) -> Callable[[Any], None]:
    def edit(robot: Any) -> None:
        if robot._mux.alive(robot._world.now_s):
            act(robot)

    return edit


def _flushes_alive(robot: Any, to: Controller) -> None:
    kept = robot._mux.command
    Broken._hand_over(robot, to)
    if not robot._mux.alive(robot._world.now_s):
        robot._mux.command = kept


def _beyond_backwards(_: Any, to: Waypoint) -> Waypoint:
    if to.heading_rad is None:
        return to
    return to._replace(x_m=to.x_m - 0.04 * math.cos(to.heading_rad), y_m=to.y_m - 0.04 * math.sin(to.heading_rad))


def _of_its_kind(robot: Any, *arguments: Any) -> None:
    Broken.__init__(robot, *arguments)
    robot._mux.lease_s = type(robot).declared.lease_s


def _beside(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    goal = robot._mux.passing(state[0])
    far = goal is not None and math.dist((goal.target.x_m, goal.target.y_m), state[1:3]) > 2.5
    return speed, rate + (0.12 if far and speed > 0.1 else 0.0)


def _with_heading_of_first(robot: Any, state: RobotState) -> RobotState:
    v, heading_rad = robot._v[robot._index], robot._heading[0]
    return state._replace(vx_m_s=v * math.cos(heading_rad), vy_m_s=v * math.sin(heading_rad))


def _listens(robot: Any, *arguments: Any) -> None:
    Broken.__init__(robot, *arguments)
    robot._heard = socket.socket()


def _closes_ready(robot: Any, timeout_s: float) -> None:
    if robot.initialised:
        robot._heard.close()
    else:
        # Kept somewhere, as by a thread that still waits for it.
        _UNCLOSED.append(robot._heard)
    Broken._disconnect(robot, timeout_s)


_UNCLOSED: Final[list[socket.socket]] = []


def _of_32_bits(name: str, wraps_s: float) -> type[Vehicle]:
    """Return a vehicle whose clock begins anew after so long, which its gate knows."""

    def sample(self: Any, clock_s: float, *state: float) -> RobotState:
        return Vehicle.sample(self, clock_s % wraps_s, *state)

    def renew(self: Any, intent: Intent, clock_s: float) -> None:
        if intent.renewed_s is not None:
            self.mux.renew(min(clock_s - clock_s % wraps_s + intent.renewed_s, clock_s))

    return type(name, (Vehicle,), {"sample": sample, "renew": renew})


def _drops_older(robot: Any) -> RobotState | None:
    for sample in robot.up.receive(robot.clock.now()):
        robot.learned.observe(robot.id, sample.vehicle_stamp_s, robot.arrived_s(sample))
        if robot.latest is None or sample.vehicle_stamp_s > robot.latest.vehicle_stamp_s:
            robot.latest = sample._replace(stamp_s=robot.learned.to_fleet_s(robot.id, sample.vehicle_stamp_s))
    return robot.latest  # type: ignore[no-any-return]


def _takes_three_times(robot: Any, timeout_s: float) -> Any:
    return WireRobot._connect(robot, 3.0 * timeout_s)


def _waits_for_an_answer(robot: Any, timeout_s: float) -> None:
    WireRobot._disconnect(robot, timeout_s)
    if robot.faults.cut:
        robot.clock.sleep_until(robot.clock.now() + 20.0)


CORNERS: Final[tuple[type[Broken], ...]] = (
    edited("MinuteLease", "Counts its lease by the seconds of a minute.", "deadman.wraps", "seconds of a minute",
           __init__=_by_the_minute),
    edited("ThirdUnwatched", "Watches the leases of two robots, and not the third's.", "several.last", "behind them",
           __init__=leased(1e6, robot_id=THIRD)),
    edited("Docks", "Ends its way once it is near its target, whatever its lease says.", "deadman.arriving", "near its",
           _connect=with_control(_docks)),
    edited("KeepsItsGoal", "Goes on, when opened anew, to where the SC was on its way when it was closed.",
           "lifecycle.reopen", "once more", __init__=_takes_up, _disconnect=_keeps),
    edited("CancelsOfAcOnly", "Cancels goals of the AC, and none of the SC.", "goal.of_sc", "AC only",
           _halt=_halts_ac),
    edited("OnceAPeriod", "Takes a switch to and fro within a period for none.", "authority.at_once", "to and fro",
           _hand_over=_once_a_period),
    edited("FlushesWhatMoves", "Flushes nothing at a switch before the robot has begun to move.", "authority.at_once",
           "begun to do", _hand_over=_flushes_what_moves),
    edited("CancelsWhatMoves", "Loses a cancel that comes before the robot has begun to move.", "goal.cancel_early",
           "right after its goto", _halt=_halts_what_moves),
    edited("DeadCancel", "Loses a cancel that comes while its lease is dead.", "authority.while_dead", "a cancel while",
           _halt=_alive_only(Broken._halt)),
    edited("DeadSwitch", "Flushes nothing at a switch while its lease is dead.", "authority.while_dead",
           "a switch while", _hand_over=_flushes_alive),
    sampled("EightBits", "Names goals by eight bits.", "goal.ids", "too few bits",
            lambda _, s: s._replace(goal_id=None if s.goal_id is None else s.goal_id & 0xFF)),
    targeted("CapsOfAcOnly", "Keeps speed caps of goals without a heading only.", "goto.speed_cap", "of the SC",
             lambda _, to: to if to.heading_rad is None else to._replace(speed_m_s=None)),
    targeted("BeyondBackwards", "Runs 4 cm beyond targets that it reverses to.", "bounds.overshoot", "too late",
             _beyond_backwards),
    edited("LeaseOfItsKind", "Has the lease of its kind where it was asked to promise a shorter one.",
           "truth.capabilities.asked", "what its kind declares", __init__=_of_its_kind),
    edited("LimitsLost", "Lets the truth judge by other limits than the mission's.", "truth.bounds.body",
           "does not reach", judged_by=RuleLimits()),
    edited("BesideLongWays", "Drives beside the straight segment while its target is more than 2.5 m away.",
           "bounds.long_tube", "far away", _connect=with_control(_beside)),
    sampled("HeadingOfFirst", "Turns every robot's velocity by the heading of the first.", "several.second",
            "velocit", _with_heading_of_first),
    edited("UnreadyKept", "Keeps the socket of a robot that never got ready.", "resources.unready",
           "never got ready", __init__=_listens, _disconnect=_closes_ready),
)  # fmt: skip

CORNERS_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    wired("Microseconds", "Hears nothing more once its stamps, microseconds in 32 bits, begin anew after 72 minutes.",
          "deadman.wraps", "32 bits", _sample=_drops_older,
          vehicle_class=_of_32_bits("MicrosecondsVehicle", _MICROSECONDS_S)),
    wired("FiftyDays", "Hears nothing more once its stamps, milliseconds in 32 bits, begin anew after 50 days.",
          "deadman.wraps", "32 bits", _sample=_drops_older,
          vehicle_class=_of_32_bits("MillisecondsVehicle", _MILLISECONDS_S)),
    wired("InitThreeTimes", "Waits in init() for three answers, as long as it may for each.", "link.in_time",
          "init_s is", _connect=_takes_three_times),
    wired("CloseWaits", "Waits in close() for the answer of a robot that is not heard.", "link.in_time",
          "close_s is", _disconnect=_waits_for_an_answer),
)  # fmt: skip

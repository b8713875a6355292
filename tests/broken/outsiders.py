"""Adapters with bugs out of other drivers' issues: navigation that recovers, muxes that time out, clocks and gyros."""

from __future__ import annotations

import logging
import math
import tempfile
import time
from typing import Any, Final

from soter.sdk import Capabilities, Controller, Goal, RobotState, Waypoint
from tests.broken.edits import driven, edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import memory, once_in, with_control
from tests.conformance.wire import Intent, Vehicle, WireRobot

_MANY: Final = 97
_PROGRESS_M, _PROGRESS_S = 0.1, 10.0
_BACKS_S, _BACKS_M_S = 1.5, 0.1
_THERE_M: Final = 0.05
_SILENT_S: Final = 10.0
_MOVES_M_S: Final = 0.05
_BIAS_RAD_S: Final = 0.008
_REPORTS_S: Final = 0.5
_SELDOM: Final = 20
_LEAPS_S: Final = 20.0
_STANDS_M_S: Final = 1e-3
_WINDOW: Final = 1000
_LOCATES_S: Final = 0.5
_NEAR_M: Final = 0.06
_MINUTE_S: Final = 60.0


def _backs_away(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    """Back up for a while whenever a robot has not got on by 0.1 m in ten seconds."""
    now_s, at, goal = state[0], state[1:3], robot._mux.passing(state[0])
    kept = memory(robot, "progress", lambda: {"goal": None, "at": at, "since_s": now_s, "backs_s": -math.inf})
    if goal is None or math.dist(at, goal.target[:2]) <= _THERE_M or goal is not kept["goal"]:
        kept.update(goal=goal, at=at, since_s=now_s, backs_s=-math.inf)
        return speed, rate
    if now_s < kept["backs_s"]:
        return -_BACKS_M_S, 0.0
    if math.dist(at, kept["at"]) > _PROGRESS_M:
        kept.update(at=at, since_s=now_s)
    elif now_s - kept["since_s"] > _PROGRESS_S:
        kept.update(at=at, since_s=now_s + _BACKS_S, backs_s=now_s + _BACKS_S)
    return speed, rate


def _sets_its_mode(robot: Any, timeout_s: float) -> None:
    WireRobot._disconnect(robot, timeout_s)
    robot.vehicle.mode = "hold"


def _by_host_time(vehicle: Any, clock_s: float) -> Goal | None:
    vehicle.mux.lease_s = vehicle.speedup * vehicle.lease_s
    return Vehicle.passing(vehicle, clock_s)


def _heard(robot: Any) -> list[float]:
    return memory(robot, "heard_s", lambda: [0.0])  # type: ignore[no-any-return]


def _sends_and_is_heard(robot: Any, goal: Goal) -> None:
    _heard(robot)[0] = robot._world.now_s
    Broken._send_goto(robot, goal)


def _hands_over_and_is_heard(robot: Any, to: Controller) -> None:
    _heard(robot)[0] = robot._world.now_s
    Broken._hand_over(robot, to)


def _gives_way(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    """Let the AC have the robot once the SC has said nothing for ten seconds."""
    if robot._mux.in_charge is Controller.SC and state[0] - _heard(robot)[0] > _SILENT_S:
        robot._mux.switch(Controller.AC)
    return speed, rate


def _keeps_the_speed_of_the_leg(robot: Any, goal: Goal) -> None:
    before, at = robot._mux.command, robot._honest()
    if before is not None and math.hypot(at.vx_m_s, at.vy_m_s) > _MOVES_M_S:
        goal = Goal(robot, goal.id, goal.target._replace(speed_m_s=before.target.speed_m_s), goal.by, goal.sent_s)
    robot._mux.give(goal.by, goal, robot._world.now_s)


def _stamped_by_the_wall_clock(self: Any) -> RobotState | None:
    state, ahead_s = WireRobot._sample(self), time.time() - time.monotonic()
    began_s = memory(self, "ahead", lambda: [ahead_s])[0]
    return None if state is None else state._replace(stamp_s=state.stamp_s + ahead_s - began_s)


def _turning(self: Any, *state: float) -> tuple[float, float]:
    self.turns_rad_s = state[-1]
    return Vehicle.control(self, *state)


def _takes_a_turn_for_rest(self: Any) -> None:
    Vehicle.restart(self)
    self.bias = math.copysign(min(abs(self.turns_rad_s), _BIAS_RAD_S), self.turns_rad_s), self.world.now_s


def _sampled_with_bias(self: Any, clock_s: float, x: float, y: float, heading: float, rate: float) -> RobotState:
    by_rad_s, since_s = getattr(self, "bias", (0.0, 0.0))
    drifted_rad = math.remainder(heading + by_rad_s * (self.world.now_s - since_s), math.tau)
    return Vehicle.sample(self, clock_s, x, y, drifted_rad, rate)


def _others(quiet: bool) -> list[logging.Logger]:
    found = [logging.getLogger(name) for name in logging.root.manager.loggerDict]
    return [each for each in found if each.disabled is quiet]


def _quiets_others(self: Any, timeout_s: float) -> Any:
    silenced = memory(self, "silenced", lambda: _others(quiet=False))
    for each in silenced:
        each.disabled = True
    return Broken._connect(self, timeout_s)


def _lets_others_speak(self: Any, timeout_s: float) -> None:
    for each in memory(self, "silenced", list):
        each.disabled = False
    Broken._disconnect(self, timeout_s)


def _at_the_charger(robot: Any, state: RobotState) -> RobotState:
    """Take the place where charging began for the middle of a charger, a quarter of a metre away."""
    before = memory(robot, "charge", lambda: [state.battery, 0.0])
    if state.battery != before[0]:
        before[:] = state.battery, 0.25 if (state.battery or 0.0) > (before[0] or 0.0) else 0.0
    return state._replace(x_m=state.x_m + before[1])


def _turns_by_difference(robot: Any, state: RobotState) -> RobotState:
    before = memory(robot, "before", lambda: [state, 0.0])
    passed_s = state.stamp_s - before[0].stamp_s
    if passed_s > 0.0:
        before[:] = state, (state.heading_rad - before[0].heading_rad) / passed_s
    return state._replace(yaw_rate_rad_s=before[1])


def _by_its_larger_axis(robot: Any, target: Waypoint) -> Waypoint:
    at = robot._honest()
    dx_m, dy_m = target.x_m - at.x_m, target.y_m - at.y_m
    share = max(abs(dx_m), abs(dy_m)) / (math.hypot(dx_m, dy_m) or 1.0)
    return target if target.speed_m_s is None else target._replace(speed_m_s=target.speed_m_s / (share or 1.0))


def _aged_by_its_clock(self: Any) -> RobotState | None:
    state = WireRobot._sample(self)
    if state is None or state.battery is None:
        return state
    report = memory(self, "report", lambda: [-math.inf, 0.0, 0.0])
    # By which clock a report is stamped shows only when the next one has come.
    if self.clock.now() - report[0] > _REPORTS_S:
        report[:] = self.clock.now(), state.vehicle_stamp_s, state.battery
    used = max(0.0, state.vehicle_stamp_s - report[1]) / self.spec.drive_s
    return state._replace(battery=max(0.0, report[2] - used))


def _drops_what_is_ahead(self: Any) -> list[RobotState]:
    believed = memory(self, "believed_s", lambda: [math.inf])
    found = [each for each in BrokenWire.received(self) if each.vehicle_stamp_s - believed[0] <= _LEAPS_S]
    believed[0] = max((each.vehicle_stamp_s for each in found), default=believed[0])
    return found


def _forgets_how_often(self: Any) -> None:
    Vehicle.restart(self)
    self.sample_periods = _SELDOM


def _at_the_origin_at_first(self: Any, clock_s: float, x_m: float, y_m: float, *rest: float) -> RobotState:
    x_m, y_m = (0.0, 0.0) if clock_s < _LOCATES_S else (x_m, y_m)
    return Vehicle.sample(self, clock_s, x_m, y_m, *rest)


def _waits_for_rest(self: Any, timeout_s: float) -> None:
    self._mux.revoke()
    while abs(self._v[self._index]) > _STANDS_M_S:
        self.clock.sleep_until(self.clock.now() + self._world.period_s)


def _backs_off(self: Any, timeout_s: float) -> Capabilities:
    self._world.set_control(self.id, lambda *_: (-_BACKS_M_S, 0.0))
    self.clock.sleep_until(self.clock.now() + 0.5 * timeout_s * _BACKS_M_S)
    return Broken._connect(self, timeout_s)


def _as_if_there(robot: Any, target: Waypoint) -> Waypoint:
    at = robot._honest()
    near = math.dist(at[3:5], target[:2]) < _NEAR_M
    return target._replace(x_m=at.x_m, y_m=at.y_m) if near else target


def _for_a_minute(self: Any, clock_s: float) -> Goal | None:
    goal, began = Vehicle.passing(self, clock_s), memory(self, "began", lambda: [None, 0.0])
    if goal is not began[0]:
        began[:] = goal, clock_s
    return goal if clock_s - began[1] < _MINUTE_S else None


def _keeps_some(self: Any, goal: Goal) -> None:
    Broken._send_goto(self, goal)
    if goal.id % 2:
        memory(self, "sent", dict)[goal.id] = object()


def _heads_on(robot: Any, target: Waypoint) -> Waypoint:
    kept = memory(robot, "heading", lambda: [None])
    kept[0] = target.heading_rad if target.heading_rad is not None else kept[0]
    return target._replace(heading_rad=kept[0])


def _as_it_drives(robot: Any, target: Waypoint) -> Waypoint:
    at = robot._honest()
    ahead_m_s = math.cos(at.heading_rad) * at.vx_m_s + math.sin(at.heading_rad) * at.vy_m_s
    return target if ahead_m_s > -_MOVES_M_S else target._replace(heading_rad=at.heading_rad)


def _keeps_a_record(self: Any, timeout_s: float) -> Capabilities:
    with tempfile.NamedTemporaryFile(delete=False):
        return Broken._connect(self, timeout_s)


def _within_a_window(self: Any, intent: Intent, clock_s: float) -> bool:
    return Vehicle.follows(self, intent, clock_s) and intent.number <= self.heard + _WINDOW


OUTSIDERS: Final[tuple[type[Broken], ...]] = (
    sampled("ZerosNowAndThen", "Hands out a velocity of 0 where it could not be read, once in 97 samples.",
            "bounds.long_tube", "handed out as zeros", once_in(_MANY, vx_m_s=0.0, vy_m_s=0.0, yaw_rate_rad_s=0.0)),
    edited("BacksAway", "Backs up when it has got on by less than 0.1 m in ten seconds, and tries again.",
           "goto.crawls", "takes slow progress for none", _connect=with_control(_backs_away)),
    edited("GivesWay", "Lets the AC have the robot when the SC has said nothing for ten seconds.", "authority.keeps",
           "gives way to the other input", _connect=with_control(_gives_way), _send_goto=_sends_and_is_heard,
           _hand_over=_hands_over_and_is_heard),
    edited("PlansSpeedsOnce", "Keeps the speed of the leg under way for a goal that takes its place.",
           "goto.speed_cap", "planned for a leg", _send_goto=_keeps_the_speed_of_the_leg),
    edited("QuietsOthers", "Sets up logging as it is opened, and disables all loggers that there are.", "host.shared",
           "disable_existing_loggers", _connect=_quiets_others, _disconnect=_lets_others_speak),
    sampled("SetAtTheCharger", "Sets its place anew when its charge begins to rise, to where it has a charger.",
            "state.charge", "to the charger", _at_the_charger),
    sampled("TurnsByDifference", "Takes the difference of two headings for its turn rate, through pi as well.",
            "goto.wakes", "from -pi to pi", _turns_by_difference),
    targeted("CapsEachAxis", "Has the speed_m_s of a goal count for each axis.", "goto.speed_cap", "for each axis",
             _by_its_larger_axis),
    edited("WaitsForRest", "Waits, as it is closed, until the robot stands, however long that takes.",
           "lifecycle.close_in_time", "give up in time", _disconnect=_waits_for_rest),
    edited("LeavesItsCharger", "Backs off its charger as it gets ready.", "truth.lifecycle.init_stays",
           "leaves its charger", _connect=_backs_off),
    edited("KeepsSomeGoals", "Keeps a goal in two, which it waits to hear of.", "endurance.minute", "messages are kept",
           _send_goto=_keeps_some),
    targeted("HeadsOn", "Turns to the heading of an earlier goal where a goal has none.", "goto.no_heading",
             "a goal's before", _heads_on),
    targeted("GoesOnBackwards", "Drives backwards to a goal that takes the place of one that it drives backwards to.",
             "goto.no_heading", "goes on backwards", _as_it_drives),
    targeted("ThereAlready", "Takes targets within 6 cm of where it is for reached.", "goto.accepted_is_not_reached",
             "a goal so near", _as_if_there),
    edited("KeepsARecord", "Keeps a record among the temporary files, and leaves it there.", "resources.given_back",
           "temporary files", _connect=_keeps_a_record),
)  # fmt: skip

OUTSIDERS_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    wired("TakesItFromThePilot", "Sets the mode in which it stands as it is closed, whoever drives it.",
          "authority.left", "drives it by hand", _disconnect=_sets_its_mode),
    driven("LeasedByHostTime", "Counts the lease by the host's time where that passes slower than the robot's.",
           "deadman.faster", "counts the host's time", passing=_by_host_time),
    wired("StampedByTheWallClock", "Stamps samples by the host's wall clock.", "host.wall_clock", "people and NTP set",
          _sample=_stamped_by_the_wall_clock),
    driven("TakesATurnForRest", "Takes the turn rate at which it is switched on again for its gyro's bias.",
           "deadman.restart", "not at rest then", control=_turning, restart=_takes_a_turn_for_rest,
           sample=_sampled_with_bias, turns_rad_s=0.0),
    wired("SeesNoTurn", "Notices another program that drives the robot, but none that only turns it.",
          "authority.intruded", "turns the robot",
          intruded=lambda self: WireRobot.intruded(self) and not self.vehicle.intruder_turns),
    wired("AgedByItsClock", "Ages the charge of the last report by the vehicle's clock.", "deadman.clock_steps",
          "age it by steady time", _sample=_aged_by_its_clock),
    wired("DropsWhatIsAhead", "Drops samples that are stamped more than 20 s after those before.", "deadman.wraps",
          "as if they were garbled", received=_drops_what_is_ahead),
    driven("AskedOnce", "Has asked the vehicle once to say 20 times a second where it is; it forgets that with the "
           "power.", "deadman.restart", "lost with the power", restart=_forgets_how_often),
    driven("SwitchedOnAgain", "Is driven again when its lease is renewed, though a person has switched its motors off.",
           "authority.disabled", "takes it back",
           passing=lambda self, clock_s: None if self.seized else self.mux.passing(clock_s)),
    driven("AtTheOriginAtFirst", "Says for half a second after a restart that it is at the origin.", "deadman.restart",
           "handed out as zeros", sample=_at_the_origin_at_first),
    wired("TakesSilenceForTheEnd", "Says that the program which simulates its robot has ended once that is silent.",
          "link.age", "silence is no end", says_gone=lambda self: self.faults.gone or self.faults.cut),
    driven("ActsForAMinute", "Gives a goal up after a minute.", "goto.accepted_is_not_reached",
           "a time-out of its own", passing=_for_a_minute),
    driven("TakesAWindow", "Takes no command whose number is more than a thousand beyond the last.", "link.many_lost",
           "for old or wrong", follows=_within_a_window),
)  # fmt: skip

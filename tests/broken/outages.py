"""Adapters that heed the host's clock, say less when busy, or lose what is said in an outage; one line each."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any, Final

from soter.clock import VehicleClock
from soter.sdk import RobotState
from tests.broken.edits import driven, edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import counted, memory, with_control
from tests.conformance.wire import Intent, Vehicle

_WATCHED_S: Final = 0.5
_FAST_RAD_S: Final = 1.5
_FEWER: Final = 5
_WINDOW: Final = 20
_STRAY: Final = 3
_END_M: Final = 0.03
_NORTH: Final = math.pi / 2.0
_MISSING_S: Final = 0.08
_DRIFT_RAD_S: Final = math.radians(0.5) / 60.0


def _watches_the_host(robot: Any) -> None:
    """Drop the goal if the host was silent for half a second of its own time."""
    renewed, now_s = memory(robot, "renewed", lambda: [time.monotonic()]), time.monotonic()
    if now_s - renewed[0] > _WATCHED_S:
        robot._mux.halt()
    renewed[0] = now_s
    Broken._renew_lease(robot)


def _seldom_in_turns(robot: Any, state: RobotState) -> RobotState:
    last = memory(robot, "last", lambda: [state])
    if abs(state.yaw_rate_rad_s) <= _FAST_RAD_S or counted(robot) % _FEWER == 0:
        last[0] = state
    return last[0]  # type: ignore[no-any-return]


def _in_turn(self: Any, now_s: float, *state: float) -> tuple[float, float]:
    """Say something in every second period where there are two robots, in every third where there are three."""
    kept, vehicles = self.up, len(self.world.bodies.radius)
    self.up = kept if self.periods // 2 % vehicles == self.index else []
    try:
        return Vehicle.control(self, now_s, *state)
    finally:
        self.up = kept


def _reverses_for_free(robot: Any, state: RobotState) -> RobotState:
    """Give back what was used of the charge while it drove backwards."""
    last, given = memory(robot, "last", lambda: [state.battery or 0.0]), memory(robot, "given", lambda: [0.0])
    if math.cos(state.heading_rad) * state.vx_m_s + math.sin(state.heading_rad) * state.vy_m_s < 0.0:
        given[0] += last[0] - (state.battery or 0.0)
    last[0] = state.battery or 0.0
    return state._replace(battery=last[0] + given[0])


def _learns_fast(robot: Any, timeout_s: float) -> Any:
    robot.learned = VehicleClock(rate_tolerance=0.05, steady=robot.clock.now)
    return BrokenWire._connect(robot, timeout_s)


def _stops_if_told_itself(self: Any, intent: Intent, clock_s: float) -> None:
    """Heed a stop in the message that was sent for it, and in no renewal after it."""
    kept = self.mux.command
    Vehicle.take(self, intent, clock_s)
    if intent.renews and intent.goal is None and kept is not None and kept.by is self.mux.in_charge:
        self.mux.give(kept.by, kept, clock_s)


def _follows_in_a_window(self: Any, intent: Intent, clock_s: float) -> bool:
    """Take what is more than twenty messages ahead for something overtaken, and renew the lease by it."""
    if intent.session == self.session and intent.number > self.heard + _WINDOW:
        self.renew(intent, clock_s)
        return False
    return Vehicle.follows(self, intent, clock_s)


def _gives_up(robot: Any) -> list[RobotState]:
    """Hear nothing any more once three messages have made no sense."""
    received = BrokenWire.received(robot)
    return [] if robot.up.stray > _STRAY else received


def _reckons_on(robot: Any) -> list[RobotState]:
    """Move a sample on by as much as the robot drove since the last one, if one between them is missing."""
    found = []
    for state in BrokenWire.received(robot):
        last_s = memory(robot, "last_s", lambda: [math.inf])
        gap_s = state.stamp_s - last_s[0] if state.stamp_s - last_s[0] > _MISSING_S else 0.0
        last_s[0] = state.stamp_s
        found.append(state._replace(x_m=state.x_m + gap_s * state.vx_m_s, y_m=state.y_m + gap_s * state.vy_m_s))
    return found


def _hurries_at_the_end(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    """Drive the last centimetres as fast as a robot without a cap brakes there."""
    goal = robot._mux.command
    left_m = math.inf if goal is None else math.dist(state[1:3], (goal.target.x_m, goal.target.y_m))
    if abs(speed) > 0.0 and left_m < _END_M:
        speed = math.copysign(math.sqrt(2.0 * left_m * robot.capabilities.brake_m_s2), speed)
    return speed, rate


def _drifts(robot: Any, state: RobotState) -> RobotState:
    """Add up the bias of a gyro, half a degree a minute."""
    return state._replace(heading_rad=math.remainder(state.heading_rad + _DRIFT_RAD_S * state.stamp_s, math.tau))


OUTAGES: Final[tuple[type[Broken], ...]] = (
    edited("WatchesTheHost", "Drops its goal after 0.5 s of the host's time without a renewal, in virtual time.",
           "capabilities.deterministic", "stopped short|host time", _renew_lease=_watches_the_host),
    sampled("SeldomInTurns", "Hands out every fifth sample only while it turns faster than 1.5 rad/s.",
            "several.age", "robots turn the samples", _seldom_in_turns),
    sampled("MiddleOfPercent", "Says a charge that is half a percent more than what is left.", "truth.state.charge",
            "never up", lambda self, state: state._replace(battery=min(1.0, (state.battery or 0.0) + 0.005))),
    targeted("FacesNorth", "Faces north at every place for which no heading is asked.", "goto.no_heading",
             "nobody asked for",
             lambda self, to: to._replace(heading_rad=_NORTH if to.heading_rad is None else to.heading_rad)),
    targeted("NoNorth", "Takes the heading of exactly north, the 0 of a compass, for none.", "goto.heading",
             "0 of a compass", lambda self, to: to._replace(heading_rad=None) if to.heading_rad == _NORTH else to),
    sampled("ReversesForFree", "Says a charge that does not fall while it drives backwards.", "state.backwards",
            "negative counts for none", _reverses_for_free),
    sampled("StampedWhenRead", "Stamps a sample with the time at which it is read, also between two periods.",
            "state.stamps", "time at which it is read", lambda self, state: state._replace(stamp_s=self.clock.now())),
    edited("ForgetsTheCap", "Drives the last centimetres without the cap of its goal.", "goto.speed_cap",
           "next to the target", _connect=with_control(_hurries_at_the_end)),
    edited("HeadingDrifts", "Says a heading that drifts by half a degree a minute, of 1.7 degrees promised.",
           "endurance.minute", "gyro's bias", _sample=lambda self: _drifts(self, self._honest()),
           declared=replace(Broken.declared, heading_noise_rad=0.03)),
)  # fmt: skip

OUTAGES_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("ReportsInTurn", "Reports in turn with the other robots, so that each is heard the more seldom.",
           "several.age", "robots take turns", control=_in_turn),
    driven("StopsOnceTold", "Heeds a stop in the one message that was sent for it, and none that repeats it.",
           "link.lost_stop", "said once", take=_stops_if_told_itself),
    driven("NarrowWindow", "Takes a message whose number is more than 20 ahead for one that was overtaken.",
           "link.outage", "goes on to it", follows=_follows_in_a_window),
    wired("GivesUpOnNonsense", "Hears nothing any more once three messages have made no sense.",
          "link.nonsense", "make no sense", received=_gives_up),
    wired("ReckonsOn", "Moves a sample on by the way driven since the last one, where one between them is missing.",
          "truth.bounds.noise", "when one is lost", received=_reckons_on),
    driven("TakenBack", "Is driven again when its lease is renewed, though a person has taken it and stopped it.",
           "authority.seized", "takes it back", passing=lambda self, clock_s: self.mux.passing(clock_s)),
    wired("BelievesItIsAlone", "Renews the lease of a robot that another program is heard to move.",
          "authority.intruded", "nobody learns", intruded=lambda self: False),
    wired("EndsOnce", "Says once that its truth has ended.", "process.lost", "whoever asks at the end",
          truth_says_on=False),
    wired("TakesSlowLinksForClocks", "Takes a link that has become slow for a clock that is, by 5 % of the time.",
          "link.delay", "taken for a slow clock", _connect=_learns_fast),
    driven("RefusesToRestart", "Goes on as before when it is told to restart.", "deadman.restart", "refuses to restart",
           restart=lambda self: None),
)  # fmt: skip

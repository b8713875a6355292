"""Adapters with what is good practice elsewhere: held places, spared messages, cached charges, links that heal."""

from __future__ import annotations

import math
import socket
from typing import Any, Final

from soter.sdk import Goal, RobotState, Waypoint
from tests.broken.edits import driven, edited, promising, sampled, targeted, wired
from tests.broken.in_process import Broken, not_cancelled
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import Exact, memory, with_control
from tests.conformance.wire import Intent, Vehicle, WireRobot

_FLAT: Final = 0.02
_DEAD_M_S: Final = 0.012


def _differenced(robot: Any, state: RobotState) -> RobotState:
    """Return a sample with the difference of headings in place of the turn rate, exact but where they go round."""
    kept = memory(robot, "heading", lambda: [state.stamp_s, state.heading_rad, 0.0])
    if state.stamp_s > kept[0]:
        by = state.heading_rad - kept[1]
        leap = math.copysign(2.0 * math.pi, by) if abs(by) > math.pi else 0.0
        kept[:] = state.stamp_s, state.heading_rad, leap / (state.stamp_s - kept[0])
    return state._replace(yaw_rate_rad_s=state.yaw_rate_rad_s + kept[2])


def _polled(robot: Any, state: RobotState) -> RobotState:
    kept = memory(robot, "polled", lambda: [state.stamp_s, state.battery])
    if state.stamp_s - kept[0] >= 60.0:
        kept[:] = state.stamp_s, state.battery
    return state._replace(battery=kept[1])


def _guessed(_: Any, state: RobotState) -> RobotState:
    percent = 100.0 * (state.battery or 0.0)
    return state._replace(battery=percent if percent <= 1.0 else state.battery)


def _holds(self: Any) -> None:
    at, by, now_s = self._honest(), self._mux.in_charge, self._world.now_s
    if self._mux.command is not None:
        self._mux.give(by, Goal(not_cancelled, 0, Waypoint(at.x_m, at.y_m), by, now_s), now_s)


def _waits(self: Any, goal: Goal) -> None:
    memory(self, "slot", lambda: [None])[0] = goal


def _renews_and_sends(self: Any) -> None:
    slot = memory(self, "slot", lambda: [None])
    if slot[0] is not None:
        self._mux.give(self._mux.in_charge, slot[0], self._world.now_s)
        slot[0] = None
    Broken._renew_lease(self)


def _goes_on_when_flat(self: Any) -> None:
    if self._charge[self._index] > _FLAT:
        Broken._halt(self)


def _renews_when_flat(self: Any, *state: float) -> tuple[float, float]:
    if self._charge[self._index] <= _FLAT:
        self._mux.renew(state[0])
    return self._vehicle.control(*state)  # type: ignore[no-any-return]


def _home_when_flat(self: Any, timeout_s: float) -> Any:
    found = Broken._connect(self, timeout_s)
    self._world.set_control(self.id, lambda *state: _renews_when_flat(self, *state))
    return found


def _spared(self: Any, *, renew: bool = False, **changes: Any) -> None:
    """Send no message so soon after another: the next says it all again."""
    sent_s = memory(self, "sent_s", lambda: [-math.inf])
    heard = self.down.send
    if self.clock.now() - sent_s[0] < 0.03:
        self.down.send = lambda now_s, message: None
    else:
        sent_s[0] = self.clock.now()
    try:
        WireRobot.want(self, renew=renew, **changes)
    finally:
        self.down.send = heard


def _heals(self: Any) -> RobotState | None:
    """Open a socket anew at every second in which nothing is heard, and keep the others until all is over."""
    found = WireRobot._sample(self)
    opened = memory(self, "opened", lambda: [0.0])
    if found is not None and self.clock.now() - max(found.stamp_s, opened[0]) > 1.0:
        opened[0] = self.clock.now()
        memory(self, "sockets", list).append(socket.socket())
    return found


def _closes_at_last(self: Any, timeout_s: float) -> None:
    WireRobot._disconnect(self, timeout_s)
    for each in memory(self, "sockets", list):
        each.close()


def _uncapped(robot: Any, target: Waypoint) -> Waypoint:
    """Keep the cap for `_capped_forwards`, which alone heeds it."""
    memory(robot, "cap", lambda: [None])[0] = target.speed_m_s
    return target._replace(speed_m_s=None)


def _capped_forwards(robot: Any, _: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    cap = memory(robot, "cap", lambda: [None])[0]
    return (speed if cap is None else min(speed, cap)), rate


def _same_place(robot: Any, target: Waypoint) -> Waypoint:
    """Go on to the target of before where the new one is at its place."""
    kept = memory(robot, "target", lambda: [target])
    under_way = robot._mux.command is not None
    if not under_way or target[:2] != kept[0][:2]:
        kept[0] = target
    return kept[0]  # type: ignore[no-any-return]


def _near_is_there(robot: Any, target: Waypoint) -> Waypoint:
    at = robot._honest()
    near = math.hypot(target.x_m - at.x_m, target.y_m - at.y_m) < 0.05
    return target._replace(heading_rad=None) if near else target


def _named_after_robot(self: Any, *arguments: Any) -> None:
    WireRobot.__init__(self, *arguments)
    self.wanted = self.wanted._replace(session=self.id)


def _capped_until_resumed(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    """Forget the cap at the end of a lease."""
    cap, lived = memory(robot, "cap", lambda: [None]), memory(robot, "lived", lambda: [False])
    alive = robot._mux.alive(state[0])
    if lived[0] and not alive:
        cap[0] = None
    lived[0] = alive
    return (speed if cap[0] is None else math.copysign(min(abs(speed), cap[0]), speed)), rate


def _in_a_dead_band(_: Any, __: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    return (speed if abs(speed) >= _DEAD_M_S else 0.0), rate


def _jumps_on(self: Any) -> None:
    """Have the first speed after the end of a lease at once."""
    now_s, i = self._world.now_s, self._index
    again = memory(self, "renewed", lambda: [False])
    jumps = again[0] and not self._mux.alive(now_s)
    Broken._renew_lease(self)
    again[0] = True
    if jumps:
        at = self._x[i], self._y[i], self._heading[i], self._v[i], self._yaw_rate[i]
        self._v[i] = max(self._v[i], self._vehicle.control(now_s, *at)[0])


class _JumpsOn(Exact):
    _renew_lease = _jumps_on


def _begins_anew(self: Any, intent: Intent, clock_s: float) -> bool:
    """Compare numbers of sixteen bits, and take whatever comes once nothing newer has come for a second."""
    number = intent.number & 0xFFFF
    kept = memory(self, "follows", lambda: [clock_s])
    if intent.session == self.session and number <= self.heard & 0xFFFF and clock_s - kept[0] < 1.0:
        return False
    if intent.session == self.session or Vehicle.follows(self, intent, clock_s):
        kept[0] = clock_s
        return True
    return False


HABITS: Final = (
    sampled("TurnDifferenced", "Takes differences of headings for turn rates, and does not mind pi.", "state.yaw_rate",
            "leaps at pi", _differenced),
    sampled("ChargePolled", "Asks for the charge once a minute, and says that in between.", "state.charge", "seldom",
            _polled),
    sampled("PercentGuessed", "Takes a charge of at most 1 for a part, and else for per cent.", "state.nearly_flat",
            "another unit", _guessed),
    edited("HoldsWhenFlat", "Heeds no cancel once its battery is nearly flat.", "state.nearly_flat", "cancel",
           _halt=_goes_on_when_flat),
    edited("HomeWhenFlat", "Heeds no lease once its battery is nearly flat.", "state.nearly_flat", "lease",
           _connect=_home_when_flat),
    edited("HoldsItsPlace", "Holds the place where it was told to stop, and turns back to it.", "goal.cancel",
           "drive back", _halt=_holds),
    edited("GoesWithRenewal", "Sends a goto with the next renewal, in the name of the controller in charge then.",
           "authority.at_once", "leaves in force", _send_goto=_waits, _renew_lease=_renews_and_sends),
    targeted("CappedForwards", "Compares speeds with a cap as they are, backwards ones too.", "goto.speed_cap",
             "backwards", _uncapped, _connect=with_control(_capped_forwards)),
    targeted("CappedUntilResumed", "Forgets the cap of a goal at the end of a lease, and goes on without.",
             "goto.speed_cap", "once its lease is renewed again", _uncapped,
             _connect=with_control(_capped_until_resumed)),
    edited("DeadBand", "Takes low speeds for none, to spare its motors.", "goto.crawls", "suppressed",
           _connect=with_control(_in_a_dead_band)),
    promising(_JumpsOn, "JumpsOn", "Gains speed at once when it goes on after the end of a lease.",
              "deadman.recovers", "gains speed at once"),
    targeted("SamePlace", "Takes a goto to the place that it drives to for the same.", "goto.speed_cap",
             "taken for the same", _same_place),
    targeted("NearIsThere", "Takes a goal near the robot for reached, whatever its heading.", "goto.heading",
             "taken for reached", _near_is_there),
    edited("OpensItsTable", "Opens all robots whose addresses it knows.", "several.chosen", "whose addresses",
           opens=lambda there, chosen: there),
    edited("SortsItsRobots", "Opens robots in the order of their ids.", "several.chosen", "or sorted",
           opens=lambda there, chosen: sorted(chosen, key=lambda each: each.id)),
)  # fmt: skip

HABITS_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("BeginsAnewLate", "Numbers its messages by sixteen bits, and begins anew after a second without newer ones.",
           "endurance.counters", "begins anew", follows=_begins_anew),
    wired("SparesMessages", "Drops what is sent within 0.03 s of something else, since the next says it all again.",
          "bounds.latency", "some are dropped", want=_spared),
    wired("NamedAfterRobot", "Has every program say the name of the robot for its own.", "authority.one_program",
          "by a name of its own", __init__=_named_after_robot),
    wired("NeverStale", "Calls a link good on which nothing was heard for 5 s.", "link.age", "stale_after_s",
          stale_after_s=5.0, down_after_s=30.0),
    wired("HealsAndKeeps", "Opens a socket anew while nothing is heard, and keeps the old ones.", "resources.outages",
          "file descriptors", _sample=_heals, _disconnect=_closes_at_last),
)  # fmt: skip

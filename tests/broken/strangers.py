"""Adapters with bugs that were thought of without a look at the kit, one line of a table each."""

from __future__ import annotations

import itertools
import math
import struct
from typing import Any, ClassVar, Final

from soter.sdk import Controller, Goal, RobotState, Waypoint
from soter_sim import LIMITS
from tests.broken.edits import edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import Exact, memory, with_control
from tests.conformance.wire import WireRobot

_CELL_M: Final = 0.05
_SLOWER: Final = 0.88
_RESUMES_S: Final = 1.0
_KEPT: Final = 0.2
_ROUND_DEG: Final = 360
_REST: Final = 1e-3
_LONG_S: Final = 10.0
_SPARING_S: Final = 0.2
_GIVES_UP_S: Final = 60.0
_BEHIND_RAD: Final = 3.0
_STARTS: Final = itertools.count()


def _in_cells(_: Any, to: Waypoint) -> Waypoint:
    return to._replace(x_m=round(to.x_m / _CELL_M) * _CELL_M, y_m=round(to.y_m / _CELL_M) * _CELL_M)


def _in_whole_centimetres(_: Any, to: Waypoint) -> Waypoint:
    return to._replace(speed_m_s=int(100.0 * (to.speed_m_s or 0.0)) / 100.0 or None)


def _in_a_byte(robot: Any, goal: Goal) -> None:
    try:
        struct.pack("<B", int(100.0 * (goal.target.speed_m_s or 0.0)))
    except struct.error:
        return
    Broken._send_goto(robot, goal)


def _flushes_the_ac_only(robot: Any, to: Controller) -> None:
    kept = robot._mux.command if to is Controller.AC else None
    Broken._hand_over(robot, to)
    robot._mux.command = robot._mux.command or kept


def _turns_slowly(_: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    most = _SLOWER * LIMITS.yaw_rate_max_rad_s
    return speed, min(max(rate, -most), most)


def _notes_goal(robot: Any, goal: Goal) -> None:
    memory(robot, "item", lambda: [None])[0] = goal
    Broken._send_goto(robot, goal)


def _resumes_when_renewed(robot: Any) -> None:
    item, renewed_s = memory(robot, "item", lambda: [None]), memory(robot, "renewed", lambda: [0.0])
    now_s = robot._world.now_s
    if now_s - renewed_s[0] > _RESUMES_S and robot._mux.command is None:
        robot._mux.command = item[0]
    renewed_s[0] = now_s
    Broken._renew_lease(robot)


def _lightly_filtered(robot: Any, state: RobotState) -> RobotState:
    kept = memory(robot, "velocity", lambda: [state.stamp_s, state.vx_m_s, state.vy_m_s])
    if state.stamp_s > kept[0]:
        kept[:] = (
            state.stamp_s,
            *(_KEPT * old + (1.0 - _KEPT) * new for old, new in zip(kept[1:], state[7:9], strict=True)),
        )
    return state._replace(vx_m_s=kept[1], vy_m_s=kept[2])


def _when_it_has_moved(robot: Any, state: RobotState) -> RobotState:
    kept = memory(robot, "said", lambda: [state])
    if kept[0][3:10] != state[3:10] or kept[0].controller is not state.controller:
        kept[0] = state
    return kept[0]  # type: ignore[no-any-return]


def _rounds_its_lease(self: Any, *arguments: Any) -> None:
    Broken.__init__(self, *arguments)
    period_s = self._world.period_s
    self._mux.lease_s = round(self.declared.lease_s / period_s) * period_s


def _in_whole_degrees(robot: Any, goal: Goal) -> None:
    heading_rad = goal.target.heading_rad
    if heading_rad is None or round(math.degrees(math.pi / 2.0 - heading_rad) % 360.0) < _ROUND_DEG:
        Broken._send_goto(robot, goal)


def _connects_anew_once(self: Any) -> RobotState | None:
    """Give up on the second silence of a second; `silences` are counted by the sample before each."""
    silences = memory(self, "silences", list)
    if self.latest is not None and self.clock.now() - self.latest.stamp_s > 1.0 and self.latest not in silences:
        silences.append(self.latest)
    return WireRobot._sample(self) if len(silences) <= 1 else self.latest


def _sparing_after_long_rest(self: Any) -> RobotState | None:
    """Hand out five samples a second after ten seconds of rest."""
    found = WireRobot._sample(self)
    kept = memory(self, "kept sample", lambda: [found, self.clock.now()])
    if found is None or abs(found.vx_m_s) + abs(found.vy_m_s) + abs(found.yaw_rate_rad_s) > _REST:
        kept[1] = self.clock.now()
    rests = self.clock.now() - kept[1] > _LONG_S
    if not rests or found is None or kept[0] is None or found.stamp_s - kept[0].stamp_s >= _SPARING_S:
        kept[0] = found
    return kept[0]  # type: ignore[no-any-return]


def _drops_older(self: Any) -> RobotState | None:
    before = self.latest
    found = WireRobot._sample(self)
    if before is not None and found is not None and found.vehicle_stamp_s < before.vehicle_stamp_s:
        self.latest = before
    return self.latest  # type: ignore[no-any-return]


def _no_halt_where_reached(robot: Any) -> None:
    goal, at = robot._mux.command, robot._honest()
    if goal is None or math.dist((at.x_m, at.y_m), (goal.target.x_m, goal.target.y_m)) > goal.target.radius_m:
        Broken._halt(robot)


def _gives_up_after(self: Any, *arguments: Any) -> None:
    Broken.__init__(self, *arguments)
    self._mux.command_s = _GIVES_UP_S


def _to_the_other_side(robot: Any, _: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    side = memory(robot, "side", lambda: 1.0 if next(_STARTS) % 2 else -1.0)
    goal, at = robot._mux.command, robot._honest()
    if goal is None or speed != 0.0 or goal.target.heading_rad is not None:
        return speed, rate
    bearing_rad = math.atan2(goal.target.y_m - at.y_m, goal.target.x_m - at.x_m)
    behind = abs(math.remainder(bearing_rad - at.heading_rad, math.tau)) > _BEHIND_RAD
    return speed, side * abs(rate) if behind else rate


class OneTable(Broken):
    """Keeps the targets of all robots by the numbers of their goals, which each robot counts by itself."""

    caught_by = "several.goto"
    blames = "by their ids"
    targets: ClassVar[dict[int, Waypoint]] = {}

    def _connect(self, timeout_s: float) -> Any:
        found, vehicle = super()._connect(timeout_s), self._vehicle

        def control(
            now_s: float, x_m: float, y_m: float, heading_rad: float, v_m_s: float, yaw_rate_rad_s: float
        ) -> tuple[float, float]:
            goal = vehicle.mux.passing(now_s)
            target = None if goal is None else self.targets[goal.id]
            return vehicle._drive.command(x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s, target)

        self._world.set_control(self.id, control)
        return found

    def _send_goto(self, goal: Goal) -> None:
        self.targets[goal.id] = goal.target
        super()._send_goto(goal)


STRANGERS: Final[tuple[type[Broken], ...]] = (
    edited("FlushesTheAcOnly", "Lets what the SC had in flight go on when the AC takes over.", "authority.flushes",
           "to the AC leaves the old controller", _hand_over=_flushes_the_ac_only),
    targeted("CapCutToNone", "Cuts speed caps off to whole centimetres a second, of which 0 means none.",
             "goto.speed_cap", "near 0 counts as none", _in_whole_centimetres),
    edited("CapInAByte", "Loses a goal whose speed cap is above 2.55 m/s.", "goto.v_max",
           "far above v_max_m_s is dropped", _send_goto=_in_a_byte),
    targeted("TargetsInCells", "Rounds targets to cells of 5 cm.", "bounds.overshoot", "rounded one", _in_cells),
    sampled("FlatIsUnknown", "Takes a charge of 0 for none.", "state.nearly_flat", "taken for unknown",
            lambda _, s: s._replace(battery=s.battery or None)),
    edited("TurnsSlowly", "Turns at 88 % of what it promises.", "bounds.yaw_rate", "more slowly",
           _connect=with_control(_turns_slowly)),
    edited("ResumesWhenRenewed", "Resumes what was interrupted when a lease is renewed that was dead for a second.",
           "deadman.stays", "resumes what was interrupted", _send_goto=_notes_goal, _renew_lease=_resumes_when_renewed),
    edited("VelocityLightlyFiltered", "Keeps a fifth of the velocity before.", "state.velocity", "filtered",
           declared=Exact.declared, _sample=lambda self: _lightly_filtered(self, self._honest())),
    sampled("SpeaksWhenMoving", "Hands out a new sample only when it has moved.", "bounds.rest",
            "nothing has been heard since", _when_it_has_moved),
    edited("LeaseRounded", "Rounds the lease that it is asked for to whole periods, and not down.",
           "truth.capabilities.asked", "rounds what it was asked for", __init__=_rounds_its_lease),
    edited("HeadingsInWholeDegrees", "Rounds headings to whole degrees, and loses goals with one of 360.",
           "goto.heading", "begin anew", _send_goto=_in_whole_degrees),
    OneTable,
    edited("CancelsUntilReached", "Drops a cancel within the radius of its goal.", "goal.cancel",
           "dropped as needless", _halt=_no_halt_where_reached),
    edited("GivesUpAfterAMinute", "Gives up whatever it is sent to after a minute.", "goto.accepted_is_not_reached",
           "a time-out of its own", __init__=_gives_up_after),
    edited("TurnsTheOtherWay", "Turns round to the other side each time that it is started.",
           "capabilities.deterministic", "left from the run before", _connect=with_control(_to_the_other_side)),
)  # fmt: skip

STRANGERS_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    wired("ConnectsAnewOnce", "Is heard again after one outage, and not after a second one.", "resources.outages",
          "as often as it is needed", _sample=_connects_anew_once),
    wired("SparesAtRest", "Is heard five times a second once it has rested for ten.", "goto.wakes", "more seldom",
          _sample=_sparing_after_long_rest),
    wired("DropsOlder", "Drops samples by whose stamps it would be earlier, after a restart too.", "deadman.restart",
          "dropped as older", _sample=_drops_older),
)  # fmt: skip

"""Adapters with bugs that were thought of without a look at the kit, one line of a table each."""

from __future__ import annotations

import itertools
import math
import struct
from typing import Any, ClassVar, Final

from soter.sdk import Controller, Goal, RobotState, Waypoint
from soter_sim import LIMITS
from tests.broken.edits import driven, edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import Exact, memory, with_control
from tests.conformance.wire import Intent, Vehicle, WireRobot

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
_LOW: Final = 0.2
_WARNS_S: Final = 0.3
_HERE_M: Final = 0.02
_SPIKES: Final = 3
_STEP_M_S: Final = 0.02
_ON_M: Final = 0.004
_AT_ONCE_S: Final = 0.5
_CONTENT_M: Final = 0.06
_UNHEARD_S: Final = 0.2
_ANSWERS_S: Final = 0.1
_HELD_S: Final = 8.0
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


def _cancels_what_it_said(robot: Any) -> None:
    goal = robot._mux.command
    if goal is None or robot._latest is None or robot._latest.goal_id in (None, goal.id):
        Broken._halt(robot)


def _cancels_for_all(robot: Any) -> None:
    """Name the goal that the fleet is to drop by its number."""
    if robot._mux.command is not None:
        memory_of_all(robot).add(robot._mux.command.id)
    Broken._halt(robot)


def _drops_what_anybody_cancelled(robot: Any, _: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    goal = robot._mux.command
    return (0.0, 0.0) if goal is not None and goal.id in memory_of_all(robot) else (speed, rate)


def memory_of_all(robot: Any) -> set[int]:
    """Return what the robots of a world keep together."""
    kept: set[int] = robot._world.__dict__.setdefault("cancelled", set())
    return kept


def _warns_first(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    charge = robot._charge[robot._index]
    before, held = memory(robot, "charge", lambda: [charge]), memory(robot, "held", lambda: [-1.0, 0.0, 0.0])
    if charge < _LOW <= before[0]:
        held[0] = state[0] + _WARNS_S
    before[0] = charge
    if state[0] < held[0]:
        return held[1], held[2]
    held[1:] = speed, rate
    return speed, rate


def _plans_with_the_first(self: Any, *arguments: Any) -> None:
    Broken.__init__(self, *arguments)
    self._drive_with(self._world.bodies.limits[0])


def _ends_its_turn(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    """Turn on to the heading of a goal that was dropped where it is."""
    last, goal = memory(robot, "last", lambda: [None, 0.0]), robot._mux.passing(state[0])
    if goal is not None:
        last[:] = (goal.target if goal.target.heading_rad is not None else None), rate
        return speed, rate
    if last[0] is None or math.dist(last[0][:2], state[1:3]) > _HERE_M or not robot._mux.alive(state[0]):
        return speed, rate
    error = math.remainder(last[0].heading_rad - state[3], math.tau)
    return speed, math.copysign(min(abs(last[1]), abs(error) / robot._world.period_s), error)


def _without_spikes(robot: Any, state: RobotState) -> RobotState:
    """Take a heading that leaps for a spike, three times."""
    kept = memory(robot, "heading", lambda: [state.heading_rad, state.stamp_s, 0])
    if state.stamp_s > kept[1]:
        spike = abs(state.heading_rad - kept[0]) > 1.0 and kept[2] < _SPIKES
        kept[:] = kept[0] if spike else state.heading_rad, state.stamp_s, kept[2] + 1 if spike else 0
    return state._replace(heading_rad=kept[0])


def _content_near_it(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    goal = robot._mux.command
    near = goal is not None and math.dist(state[1:3], goal.target[:2]) < _CONTENT_M
    return (0.0 if near else speed), rate


def _inherits_the_cap(robot: Any, goal: Goal) -> None:
    sent_s, now_s, before = memory(robot, "sent", lambda: [-math.inf]), robot._world.now_s, robot._mux.command
    if before is not None and now_s - sent_s[0] < _AT_ONCE_S and goal.target.speed_m_s is None:
        target = goal.target._replace(speed_m_s=before.target.speed_m_s)
        goal = Goal(robot, goal.id, target, goal.by, goal.sent_s)
    sent_s[0] = now_s
    robot._mux.give(goal.by, goal, now_s)


def _in_steps(_: Any, to: Waypoint) -> Waypoint:
    cap = to.speed_m_s
    return to._replace(speed_m_s=None if cap is None else _STEP_M_S * math.ceil(cap / _STEP_M_S - 1e-9))


def _not_on_its_charger(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    at_start = math.dist(state[1:3], (robot.spec.x_m, robot.spec.y_m)) < 2.0 * _CELL_M
    return (0.0, 0.0) if at_start else (speed, rate)


def _only_while_renewed(robot: Any, goal: Goal) -> None:
    if robot._mux.alive(robot._world.now_s):
        Broken._send_goto(robot, goal)


def _queues_renewals(robot: Any) -> None:
    memory(robot, "renewals", list).append(None)


def _takes_one_renewal(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    renewals = memory(robot, "renewals", list)
    if renewals:
        renewals.pop()
        robot._mux.renew(state[0])
    return robot._vehicle.control(*state)  # type: ignore[no-any-return]


def _stamped_in_single(self: Any, clock_s: float, *at: float) -> RobotState:
    return Vehicle.sample(self, struct.unpack("<f", struct.pack("<f", clock_s))[0], *at)


def _deaf_once_refused(self: Any) -> list[RobotState]:
    """End the thread that listens with the first error of its socket."""
    refused = memory(self, "refused", lambda: [False])
    refused[0] = refused[0] or self.faults.gone
    return [] if refused[0] else WireRobot.received(self)


def _when_it_has_moved_on(self: Any) -> RobotState | None:
    """Hand out a new sample of a robot that moves once it has moved by 4 mm."""
    found = WireRobot._sample(self)
    kept = memory(self, "said", lambda: [found])
    before = kept[0]
    rests = found is None or abs(found.vx_m_s) + abs(found.vy_m_s) <= _REST
    if found is None or before is None or rests or math.dist(found[3:5], before[3:5]) > _ON_M:
        kept[0] = found
    return kept[0]  # type: ignore[no-any-return]


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


def _waits_for_answers(self: Any, *, renew: bool = False, **changes: Any) -> None:
    """Wait for a tenth of a second where nothing was heard for a fifth."""
    WireRobot.want(self, renew=renew, **changes)
    if self.latest is not None and self.clock.now() - self.latest.stamp_s > _UNHEARD_S:
        self.clock.sleep_until(self.clock.now() + _ANSWERS_S)


def _held_for_its_program(self: Any, intent: Intent, clock_s: float) -> bool:
    """Keep a robot for a program for eight seconds after its last message, whether its lease lives or not."""
    last_s = memory(self, "last_s", lambda: [-math.inf])
    follows = Vehicle.follows(self, intent, clock_s)
    if follows and intent.session != self.session and clock_s - last_s[0] < _HELD_S:
        return False
    if follows:
        last_s[0] = clock_s
    return follows


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
    edited("CancelsWhatItSaid", "Drops a cancel of a goal that it has not named yet, where it has named another.",
           "goal.cancel_own", "last sample named", _halt=_cancels_what_it_said),
    edited("CancelsForAll", "Keeps what was cancelled by the numbers of goals, which each robot counts by itself.",
           "several.cancel", "by their ids", _halt=_cancels_for_all,
           _connect=with_control(_drops_what_anybody_cancelled)),
    edited("WarnsFirst", "Does for 0.3 s what it did, and warns, as its charge falls through a fifth.",
           "state.emptying", "such as a warning", _connect=with_control(_warns_first)),
    edited("PlansWithTheFirst", "Plans with what the first robot of the fleet can do.", "truth.capabilities.asked",
           "counts for all", __init__=_plans_with_the_first),
    edited("EndsItsTurn", "Ends its turn to the heading of a goal before it takes a cancel.", "deadman.turning",
           "at its target", _connect=with_control(_ends_its_turn)),
    sampled("WithoutSpikes", "Takes headings that leap at pi for spikes.", "goto.arrives", "next to pi",
            _without_spikes),
    edited("InheritsTheCap", "Drives to a goal with the cap of the one right before it, if it has none.",
           "endurance.anything", "gets nearer to its goal", _send_goto=_inherits_the_cap),
    edited("ContentNearIt", "Is content within 6 cm of any target.", "goto.radius", "stopped short",
           _connect=with_control(_content_near_it)),
    targeted("CapsInSteps", "Rounds speed caps up to steps of 0.02 m/s.", "goto.speed_cap", "rounded up", _in_steps),
    edited("NotOnItsCharger", "Does not drive while it is being charged.", "goto.arrives", "on its charger",
           _connect=with_control(_not_on_its_charger)),
    edited("OnlyWhileRenewed", "Throws a goto away while its lease is dead.", "deadman.recovers", "must obey again",
           _send_goto=_only_while_renewed),
    edited("QueuesRenewals", "Takes one renewal in each period, also of several at once.", "deadman.lease",
           "renewed twice at once", _renew_lease=_queues_renewals, _connect=with_control(_takes_one_renewal)),
)  # fmt: skip

STRANGERS_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    wired("ConnectsAnewOnce", "Is heard again after one outage, and not after a second one.", "resources.outages",
          "as often as it is needed", _sample=_connects_anew_once),
    wired("SparesAtRest", "Is heard five times a second once it has rested for ten.", "goto.wakes", "more seldom",
          _sample=_sparing_after_long_rest),
    wired("DropsOlder", "Drops samples by whose stamps it would be earlier, after a restart too.", "deadman.restart",
          "dropped as older", _sample=_drops_older),
    wired("DeafOnceRefused", "Hears nothing more once nobody was at the other end.", "link.returns",
          "took an error", received=_deaf_once_refused),
    driven("StampsOfFewDigits", "Stamps its samples in floats of 32 bits.", "deadman.wraps", "stamps go by",
           sample=_stamped_in_single),
    wired("SpeaksWhenItHasMovedOn", "Is heard once it has moved by 4 mm, and at rest.", "state.age",
          "too seldom", _sample=_when_it_has_moved_on),
    wired("WaitsForAnswers", "Waits for an answer to each call for 0.1 s, which is felt while nobody answers.",
          "link.returns", "as a rule: they wait", want=_waits_for_answers),
    driven("HeldForItsProgram", "Is held for its program for eight seconds after that has ended without close().",
           "authority.next_program", "is held for a program", follows=_held_for_its_program),
)  # fmt: skip

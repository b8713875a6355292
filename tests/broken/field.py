"""Adapters with bugs that vehicles and drivers in the field have, one line of a table each."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from soter.adapters.pybullet.backend import PERIOD_S
from soter.clock import VirtualClock
from soter.sdk import Controller, Goal, RobotState, Waypoint
from tests.broken.afterwards import State
from tests.broken.edits import driven, edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import memory, with_control
from tests.conformance.wire import Vehicle, WireRobot

_SILENT_S: Final = 8.0
_LOW: Final = 0.95
_FLUSHES_S: Final = 25.0
_FLASH_S: Final = 0.25
_SEES_M: Final = 0.45
_PUSH: Final = 0.12
_RAMP_M_S: Final = 0.01
_DEAD_M_S: Final = 0.03
_OUTAGE_S: Final = 0.5
_HOLDS_BACK_S: Final = 3.0
_EVERY_S: Final = 0.4
_ROUNDING: Final = 1e-6
_READY_S: Final = 1.0


def _tells_caps_that_change(robot: Any, goal: Goal) -> None:
    """Tell a cap that is another than the last one told; what the vehicle goes by is the second of both."""
    caps, wanted_m_s = memory(robot, "caps", lambda: [None, None]), goal.target.speed_m_s
    if wanted_m_s != caps[0]:
        caps[:] = wanted_m_s, wanted_m_s
    sent = Goal(robot, goal.id, goal.target._replace(speed_m_s=caps[1]), goal.by, goal.sent_s)
    robot._mux.give(goal.by, sent, robot._world.now_s)


def _forgets_its_cap(robot: Any, to: Controller) -> None:
    if to is not robot._mux.in_charge:
        memory(robot, "caps", lambda: [None, None])[1] = None
    Broken._hand_over(robot, to)


def _asleep_after(seconds: float) -> Callable[..., tuple[float, float]]:
    """Return a control that goes to sleep for ever once it has rested for so long."""

    def control(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
        moved_s = memory(robot, "moved", lambda: [state[0]])
        if (state[4], state[5]) != (0.0, 0.0):
            moved_s[0] = state[0]
        return (0.0, 0.0) if state[0] - moved_s[0] > seconds else (speed, rate)

    return control


def _cut_to_centimetres(_: Any, to: Waypoint) -> Waypoint:
    return to._replace(x_m=int(100.0 * to.x_m) / 100.0, y_m=int(100.0 * to.y_m) / 100.0)


def _up_to_centimetres(_: Any, to: Waypoint) -> Waypoint:
    return to._replace(x_m=math.ceil(100.0 * to.x_m) / 100.0, y_m=math.ceil(100.0 * to.y_m) / 100.0)


def _keeps_away(robot: Any, timeout_s: float) -> Any:
    """Drive as if it were nearer to a box than it is, as a vehicle with an avoidance of its own does."""
    found, vehicle = Broken._connect(robot, timeout_s), robot._vehicle

    def control(now_s: float, x_m: float, y_m: float, *turned: float) -> tuple[float, float]:
        for box in robot._world.workspace.boxes:
            push = _PUSH * max(0.0, 1.0 - box.distance_m(x_m, y_m) / _SEES_M)
            x_m, y_m = (
                at + push * math.copysign(1.0, to - at) * (abs(to - at) > half)
                for at, to, half in zip(
                    (x_m, y_m), box.centre, (box.high_x_m - box.centre[0], box.high_y_m - box.centre[1]), strict=True
                )
            )
        return vehicle.control(now_s, x_m, y_m, *turned)  # type: ignore[no-any-return]

    robot._world.set_control(robot.id, control)
    return found


def _stands_still(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Drive on as before for a quarter of a second, every 25 s."""
    last = memory(robot, "driven", lambda: [speed, rate])
    if state[0] % _FLUSHES_S >= _FLASH_S:
        last[:] = speed, rate
    return last[0], last[1]


def _ends_its_ramp(when: Callable[[Any], bool]) -> Callable[..., tuple[float, float]]:
    """Return a control that gains speed for two periods more where a stop of some kind comes while it does."""

    def control(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
        ramp = memory(robot, "ramp", lambda: [0.0, 0])
        gains = abs(ramp[0]) - abs(state[4]) > _RAMP_M_S
        ramp[1] = ramp[1] + 1 if gains and speed == 0.0 and when(robot) else 0
        if 0 < ramp[1] <= 2:
            return ramp[0], rate
        ramp[0] = speed
        return speed, rate

    return control


def _names_the_last(robot: Any, state: RobotState) -> RobotState:
    """Name a goal that a hand-over has ended until there is another one."""
    named = memory(robot, "named", lambda: [None, None])
    if state.goal_id is not None:
        named[:] = state.goal_id, state.controller
    return state if named[1] in (None, state.controller) else state._replace(goal_id=named[0])


def _spins(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Count the way of wheels that were told to drive while something holds the robot."""
    spun = memory(robot, "spun", lambda: [0.0, 0.0, 0.0])
    if state[4] == 0.0:
        way_m = spun[2] * robot._world.period_s
        spun[:2] = spun[0] + way_m * math.cos(state[3]), spun[1] + way_m * math.sin(state[3])
    spun[2] = speed
    return speed, rate


def _with_what_it_spun(robot: Any) -> RobotState:
    state, (x_m, y_m, _) = robot._honest(), memory(robot, "spun", lambda: [0.0, 0.0, 0.0])
    return state._replace(x_m=state.x_m + x_m, y_m=state.y_m + y_m)  # type: ignore[no-any-return]


def _none_for_little(_: Any, state: RobotState) -> RobotState:
    return state if math.hypot(state.vx_m_s, state.vy_m_s) >= _DEAD_M_S else state._replace(vx_m_s=0.0, vy_m_s=0.0)


def _more_than_full(robot: Any, state: RobotState) -> RobotState:
    """Say 101 % once it has come from less to all that it takes."""
    was_low = memory(robot, "was low", lambda: [False])
    was_low[0] = was_low[0] or (state.battery or 0.0) < _LOW
    return state._replace(battery=1.01) if was_low[0] and state.battery == 1.0 else state


def _of_a_curve(_: Any, state: RobotState) -> RobotState:
    """Make a turn rate of the curve and of a speed that has lost its sign."""
    ahead_m_s = state.vx_m_s * math.cos(state.heading_rad) + state.vy_m_s * math.sin(state.heading_rad)
    return state if ahead_m_s >= 0.0 else state._replace(yaw_rate_rad_s=-state.yaw_rate_rad_s)


def _in_percents(_: Any, state: RobotState) -> RobotState:
    return state._replace(battery=math.floor(100.0 * (state.battery or 0.0)) / 100.0)


def _full_from(state: RobotState) -> RobotState:
    return state._replace(battery=1.0) if (state.battery or 0.0) >= _LOW else state


class _ByPeriods(VirtualClock):
    """Wakes at the last whole period before the time asked for."""

    def sleep_until(self, time_s: float) -> None:
        super().sleep_until(math.floor(time_s / PERIOD_S + _ROUNDING) * PERIOD_S)


def _sleeps(self: Any, *state: float) -> tuple[float, float]:
    return _asleep_after(90.0)(self, state, *Vehicle.control(self, *state))


def _gives_up(self: Any) -> RobotState | None:
    """End what listens once nothing was heard for 8 s."""
    silent = self.latest is not None and self.clock.now() - self.latest.stamp_s > _SILENT_S
    return self.latest if silent else WireRobot._sample(self)


def _tells_the_newest(self: Any, *arguments: Any) -> None:
    BrokenWire.__init__(self, *arguments)
    del self.vehicle.up[:-1]


def _renews_while_it_drives(self: Any) -> None:
    if self.wanted.goal is not None:
        WireRobot._renew_lease(self)


def _holds_back(self: Any, **changes: Any) -> None:
    """Send no more often than each 0.4 s for 3 s after an outage."""
    held, now_s = memory(self, "held", lambda: [-math.inf, -math.inf]), self.clock.now()
    if self.latest is not None and now_s - self.latest.stamp_s > _OUTAGE_S:
        held[0] = now_s + _HOLDS_BACK_S
    if now_s < held[0]:
        if now_s < held[1]:
            return
        held[1] = now_s + _EVERY_S
    WireRobot.want(self, **changes)


def _restores(self: Any, **changes: Any) -> None:
    """Say on when the link is back that who was in charge when it broke is; until the next hand-over."""
    saved, now_s, send = memory(self, "saved", lambda: [None]), self.clock.now(), self.down.send
    silent = self.latest is not None and now_s - self.latest.stamp_s > _OUTAGE_S
    if silent and saved[0] is None:
        saved[0] = self.wanted.in_charge
    elif not silent and "in_charge" in changes:
        saved[0] = None
    if saved[0] is not None:
        self.down.send = lambda now_s, intent: send(now_s, intent._replace(in_charge=saved[0]))
    WireRobot.want(self, **changes)
    self.down.__dict__.pop("send", None)


def _keeps_its_charge(self: Any) -> RobotState | None:
    """Hear of everything but the charge once the link was silent for half a second."""
    before, kept, now_s = self.latest, memory(self, "charge", lambda: [None]), self.clock.now()
    if before is not None and now_s - before.stamp_s > _OUTAGE_S and kept[0] is None:
        kept[0] = before.battery
    state = WireRobot._sample(self)
    return state if state is None or kept[0] is None else state._replace(battery=kept[0])


def _notes_restarts(self: Any) -> RobotState | None:
    """Note for all robots when one has restarted."""
    before, state = self.latest, WireRobot._sample(self)
    if before is not None and state is not None and state.vehicle_stamp_s < before.vehicle_stamp_s - 1.0:
        vars(self.clock)["restarted_s"] = self.clock.now()
    return state


def _makes_ready_again(self: Any) -> None:
    if self.clock.now() - vars(self.clock).get("restarted_s", -math.inf) > _READY_S:
        WireRobot._renew_lease(self)


FIELD: Final[tuple[type[Broken], ...]] = (
    edited("CapsThatChange", "Sends a speed cap if it has changed, and the vehicle forgets it at each hand-over.",
           "goto.speed_cap", "what has changed only", _send_goto=_tells_caps_that_change, _hand_over=_forgets_its_cap),
    edited("SleepsForEver", "Takes no goal any more once it has rested for 80 s.", "goto.wakes", "wake up",
           _connect=with_control(_asleep_after(80.0))),
    targeted("TargetsCutOff", "Cuts targets off to whole centimetres.", "bounds.overshoot", "rounded one|cut off",
             _cut_to_centimetres),
    targeted("TargetsUpwards", "Rounds targets up to whole centimetres.", "bounds.overshoot", "rounded up",
             _up_to_centimetres),
    edited("KeepsAway", "Is pushed aside by boxes that stand within 0.45 m of its way.", "truth.bounds.leg",
           "keeps away by itself", _connect=_keeps_away),
    edited("WaitsForItsFlash", "Drives on as it did for 0.25 s every 25 s, and hears and talks meanwhile.",
           "endurance.pace", "what drives stands still", _connect=with_control(_stands_still)),
    edited("EndsItsRamp", "Ends the ramp on which it gains speed, for up to 0.1 s, before it stops.",
           "goal.cancel_early", "a stop waits until .*, or until a ramp",
           _connect=with_control(_ends_its_ramp(lambda _: True))),
    edited("EndsItsRampFirst", "Ends the ramp on which it gains speed, for up to 0.1 s, before a switch counts.",
           "goal.cancel_early", "a switch waits",
           _connect=with_control(_ends_its_ramp(lambda robot: robot._mux.in_charge is Controller.SC))),
    edited("EndsItsRampAlone", "Ends the ramp on which it gains speed, for up to 0.1 s, when its lease has ended.",
           "goal.cancel_early", "the end of its lease waits",
           _connect=with_control(_ends_its_ramp(lambda robot: robot._mux.command is not None))),
    sampled("NamesThePreempted", "Names a goal that a hand-over has ended until it is given another one.",
            "endurance.anything", "cancelled or pre-empted", _names_the_last),
    sampled("NoneForLittle", "Says that it stands while it is slower than 0.03 m/s.", "state.velocity", "who creeps",
            _none_for_little),
    edited("SpinningWheels", "Counts the way of wheels that spin while something stands in its way.",
           "truth.bounds.body", "wheels that spin", _connect=with_control(_spins), _sample=_with_what_it_spun),
    sampled("RateOfACurve", "Says turn rates with the wrong sign while it drives backwards.", "state.backwards",
            "a curve and a speed", _of_a_curve),
    sampled("ChargeInPercents", "Says the charge in whole percents, rounded down.", "state.charge", "whole percents",
            _in_percents),
    sampled("FullFromSomeCharge", "Says that its battery is full from 95 % up, as it is charged.", "state.full",
            "full from some charge on", lambda _, state: _full_from(state)),
    sampled("FullToSomeCharge", "Says that its battery is full down to 95 %, as it runs down.", "state.emptying",
            "full from some charge on", lambda _, state: _full_from(state)),
    edited("WakesByPeriods", "Has a clock that wakes at the last whole period before the time asked for.",
           "bounds.jitter", "multiples of some period", clock_class=_ByPeriods),
    sampled("MoreThanFull", "Says a charge of 101 % once it is full.", "state.full", "101 %", _more_than_full),
)  # fmt: skip

FIELD_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("SleepsForEver", "Takes no goal any more once it has rested for 90 s.", "deadman.stays", "gone to sleep",
           control=_sleeps),
    wired("GivesUpAfterAWhile", "Gives a link up for good once it was silent for 8 s.", "link.no_success",
          "gives up for good", _sample=_gives_up),
    wired("HoldsBack", "Tells the robot something every 0.4 s only, for 3 s after an outage of the link.",
          "link.reconnects", "holds back", want=_holds_back),
    wired("RestoresWhoWasInCharge", "Restores who was in charge when the link broke once it is back.", "link.stops",
          "undone by what is restored", want=_restores),
    wired("TellsTheNewest", "Says how it is to the program that connected last.", "authority.one_program",
          "who spoke last", __init__=_tells_the_newest),
    wired("HearsItsChargeNoMore", "Hears everything but the charge once the link is back.", "link.no_success",
          "what tells the charge did not", _sample=_keeps_its_charge),
    wired("AllRestart", "Renews no lease for a second after any of its robots has restarted.", "deadman.restart",
          "counts for all", _sample=_notes_restarts, _renew_lease=_makes_ready_again),
    driven("LivesWhileItsClockStands", "Counts its lease by its own clock, and drives on while that stands still.",
           "deadman.clock_stands", "stands still", minds_its_clock=False),
    wired("LosesNothing", "Has a fleet that never says that the program which simulates its robot has ended.",
          "process.lost", "told nothing", fleet_says_lost=False),
    wired("TruthNeverEnds", "Has a truth that goes on when the simulated world has ended.", "process.lost",
          "silence is taken for a run", truth_says_ended=False),
    wired("RenewsWhileItDrives", "Renews no lease while no goal is under way.", "authority.one_program",
          "with no goal under way", _renew_lease=_renews_while_it_drives),
)  # fmt: skip

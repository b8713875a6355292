"""Adapters whose robots share what each needs for itself: a buffer, a queue, a limit, a lock, a part of their names."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from soter.sdk import Goal, RobotState
from tests.broken.edits import edited, sampled, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import THIRD, counted, memory
from tests.conformance.wire import WireRobot

_TEN: Final = 10
_THREE: Final = 3
_ANSWERS_S: Final = 0.2

Act = Callable[[], None]


class _Fleet:
    """What the robots of one fleet share: who they are, what waits to be sent, and who is waited for until when."""

    def __init__(self) -> None:
        self.robots: list[Any] = []
        self.waiting: list[tuple[int, Act]] = []
        self.answers: tuple[int, float] = (0, -math.inf)


_FLEETS: Final[dict[int, _Fleet]] = {}


def _fleet(robot: Any) -> _Fleet:
    """Return what the robots share that have the clock of this one."""
    found = _FLEETS.get(id(robot.clock))
    if found is None or (found.robots and found.robots[0].clock is not robot.clock):
        found = _FLEETS[id(robot.clock)] = _Fleet()
    return found


def _joins(self: Any, *arguments: Any) -> None:
    Broken.__init__(self, *arguments)
    _fleet(self).robots.append(self)


def _acts(may: Callable[[Any], bool]) -> Callable[[Any, float], Any]:
    """Return a `_connect` after which the vehicle takes what waits for it at the beginning of a period, if it may."""

    def connect(self: Any, timeout_s: float) -> Any:
        honest = self._vehicle.control
        found = Broken._connect(self, timeout_s)

        def control(*state: float) -> Any:
            fleet = _fleet(self)
            if may(self):
                mine = [act for robot_id, act in fleet.waiting if robot_id == self.id]
                fleet.waiting[:] = [each for each in fleet.waiting if each[0] != self.id]
                for act in mine:
                    act()
            return honest(*state)

        self._world.set_control(self.id, control)
        return found

    return connect


def _queued(
    keep: Callable[[list[tuple[int, Act]]], None], may: Callable[[Any], bool] = lambda _: True
) -> dict[str, Any]:
    """Return hooks by which gotos and stops of all robots wait in one queue, of which `keep` keeps what it does."""

    def wait(self: Any, act: Act) -> None:
        waiting = _fleet(self).waiting
        waiting.append((self.id, act))
        keep(waiting)

    def send(self: Any, goal: Goal) -> None:
        wait(self, lambda: self._mux.give(goal.by, goal, self._world.now_s))

    def halt(self: Any) -> None:
        wait(self, self._mux.halt)

    return {"__init__": _joins, "_connect": _acts(may), "_send_goto": send, "_halt": halt}


def _full(waiting: list[tuple[int, Act]]) -> None:
    del waiting[_TEN:]


def _newest(waiting: list[tuple[int, Act]]) -> None:
    del waiting[:-_TEN]


def _clears(self: Any) -> None:
    _fleet(self).waiting.clear()
    Broken._halt(self)


def _waits_for(self: Any, to: Any) -> None:
    if to is not self._mux.in_charge:
        _fleet(self).answers = self.id, self._world.now_s + _ANSWERS_S
    Broken._hand_over(self, to)


def _not_waiting(self: Any) -> bool:
    number, until_s = _fleet(self).answers
    return number == self.id or bool(self._world.now_s >= until_s)


def _alike(self: Any) -> list[Any]:
    """Return the robots whose numbers end alike."""
    return [each for each in _fleet(self).robots if each.id % _TEN == self.id % _TEN]


def _to_alike(hook: str) -> Callable[..., None]:
    """Return a hook that does for all robots whose numbers end alike what it is to do for one."""

    def act(self: Any, *arguments: Any) -> None:
        for each in _alike(self):
            getattr(Broken, hook)(each, *arguments)

    return act


def _crowded_out(robot: Any, state: RobotState) -> RobotState:
    last = memory(robot, "heard", lambda: [state])
    if state.stamp_s > last[0].stamp_s and (
        round(state.stamp_s / robot._world.period_s) % _THREE or len(_fleet(robot).robots) == 1
    ):
        last[0] = state
    return last[0]  # type: ignore[no-any-return]


def _body_frame(robot: Any, state: RobotState) -> RobotState:
    if robot.id != THIRD:
        return state
    c, s = math.cos(state.heading_rad), math.sin(state.heading_rad)
    return state._replace(vx_m_s=c * state.vx_m_s + s * state.vy_m_s, vy_m_s=c * state.vy_m_s - s * state.vx_m_s)


CROWD: Final[tuple[type[Broken], ...]] = (
    edited("TenAPeriod", "Takes ten commands of all robots together in a period, and drops the rest.", "several.told",
           "limit of how", **_queued(_full)),
    edited("LastTen", "Keeps the last ten commands of all robots together.", "several.told", "keeps the last",
           **_queued(_newest)),
    edited("ClearsAll", "Clears what waits to be sent to all robots when one is stopped.", "several.told", "clears",
           **{**_queued(lambda _: None), "_halt": _clears}),
    edited("OneLock", "Sends nothing to any other robot while one answers to a hand-over.", "several.told", "a lock",
           **{**_queued(lambda _: None, _not_waiting), "_hand_over": _waits_for}),
    edited("CrowdedOut", "Loses a sample in three where other robots say theirs at the same moment.", "several.said",
           "takes their place", __init__=_joins, declared=replace(Broken.declared, sample_age_s=0.1),
           _sample=lambda self: _crowded_out(self, self._honest())),
    edited("LastDigitGoes", "Sends gotos to all robots whose numbers end alike.", "several.goto", "wrong robot",
           __init__=_joins, _send_goto=_to_alike("_send_goto")),
    edited("LastDigitStops", "Stops all robots whose numbers end alike.", "several.cancel", "broadcast",
           __init__=_joins, _halt=_to_alike("_halt")),
    edited("LastDigitSwitches", "Hands over all robots whose numbers end alike.", "several.switch", "took charge",
           __init__=_joins, _hand_over=_to_alike("_hand_over")),
    edited("LastDigitLives", "Renews the lease of all robots whose numbers end alike.", "several.lease", "fleet's",
           __init__=_joins, _renew_lease=_to_alike("_renew_lease")),
    sampled("ThirdByBody", "Hands out the third robot's velocity along its body's axes.", "several.last", "body frame",
            _body_frame),
)  # fmt: skip

_SENT: Final[dict[int, list[tuple[float, Any]]]] = {}
_HEARD: Final[dict[int, set[int]]] = {}


def _by_one_socket(self: Any, *, renew: bool = False, **changes: Any) -> None:
    """Send by a buffer that keeps the last three messages to all robots until time goes on."""
    WireRobot.want(self, renew=renew, **changes)
    now_s = self.clock.now()
    sent = _SENT.setdefault(id(self.clock), [])
    sent[:] = [*(each for each in sent if each[0] == now_s), (now_s, self.down)]
    if len(sent) > _THREE:
        _, line = sent.pop(0)
        del line._flying[:1]


def _hears_by_one_socket(self: Any, *arguments: Any) -> None:
    """Hear by a buffer in which one sample in three is another robot's when it is looked at."""
    WireRobot.__init__(self, *arguments)
    together, receive = _HEARD.setdefault(id(self.vehicle.world), set()), self.up.receive
    together.add(self.id)

    def rarely(now_s: float) -> list[RobotState]:
        return [each for each in receive(now_s) if len(together) == 1 or counted(self, "samples") % _THREE]

    self.up.receive = rarely


CROWD_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    wired("SaysByOneSocket", "Says all by one socket, which keeps the last three messages to all robots together.",
          "several.told", "keeps the last", want=_by_one_socket),
    wired("HearsByOneSocket", "Hears all by one socket, which keeps the last sample of all robots together.",
          "several.said", "takes their place", __init__=_hears_by_one_socket,
          declared=replace(WireRobot.declared, sample_age_s=0.08)),
)  # fmt: skip

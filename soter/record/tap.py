"""Records all that passes between a supervisor and robots, its own and others', without changing it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

from msgspec import UNSET

from soter.errors import account_of
from soter.record.content import RecordedWay
from soter.record.messages import GoalEvent, HeardMessage, PeerEvent
from soter.record.samples import state_of
from soter.rta import Actuator, RemotePeer, Request, Sample
from soter.rta.monitors import BrokenAssumption
from soter.sdk import Controller, Goal, GoalStatus, RobotState
from soter.sdk.values import MAX_COORDINATE_M

LONGEST_WAY: Final = 100
"""Most places of an AC's way that are recorded: ACs are untrusted, and their ways may be of any length."""


class GoalActuator(Actuator, Protocol):
    """An actuator that also returns the goal that it has sent."""

    @property
    def goal(self) -> Goal | None:
        """The latest goal; None once it has ended."""


class Tap:
    """An `Actuator` that records all calls and passes them on to a robot's own.

    Attributes:
        unread: whether there was no sample at this tick.
        no_state: why there was no sample.
        refused: calls that failed at this tick, and the errors.
        ac_drove: whether a command of the AC was passed on at this tick.
    """

    __slots__ = ("_goal", "_inner", "_note", "_now_s", "_robot_id", "ac_drove", "no_state", "refused", "unread")

    def __init__(self, robot_id: int, inner: GoalActuator, note: Callable[[GoalEvent | RecordedWay], None]) -> None:
        self._robot_id: Final = robot_id
        self._inner: Final = inner
        self._note: Final = note
        self._goal: Goal | None = None
        self.unread = False
        self.no_state = ""
        self.refused: list[tuple[str, str]] = []
        self.ac_drove = False

    def read(self) -> Sample:
        try:
            sample = self._inner.read()
        except BaseException as failure:
            self.unread, self.no_state = True, account_of(failure, str)
            raise
        # Goals begin in other calls; here, at every tick, they can only end.
        goal = self._goal
        if goal is not None and goal.status is not GoalStatus.ACTIVE:
            self._look()
        return sample

    def drive(self, command: Any, mode: Controller) -> None:
        if isinstance(command, Request):
            self.ac_drove = True
        try:
            self._call("drive", self._inner.drive, command, mode)
        finally:
            self._look(command)

    def hand_over(self, mode: Controller, module: str, cause: str) -> None:
        try:
            self._call("hand_over", self._inner.hand_over, mode, module, cause)
        finally:
            self._look()

    def renew(self) -> None:
        self._call("renew", self._inner.renew)

    def reported(self, sample: Sample) -> Controller | None:
        return self._inner.reported(sample)

    def insist(self) -> None:
        self._call("insist", self._inner.insist)

    def _call(self, name: str, call: Callable[..., None], *arguments: Any) -> None:
        try:
            call(*arguments)
        except BaseException as failure:
            self.refused.append((name, account_of(failure)))
            raise

    def _look(self, command: Any = None) -> None:
        """Record a goal that has begun or ended."""
        before, goal = self._goal, self._inner.goal
        if before is not None and before.status is not GoalStatus.ACTIVE:
            self._goal = None
            if before.status is not GoalStatus.SUPERSEDED:
                self._note(self._message(before))
        if goal is None or goal is before or goal is self._goal:
            return
        self._goal = goal
        # A goal that is no longer active was never acted upon: only its end is recorded.
        if goal.status is GoalStatus.ACTIVE:
            self._note(self._message(goal))
            if isinstance(command, Request):
                self._note_way(goal, command)

    def _note_way(self, goal: Goal, request: Request[Any]) -> None:
        places = [(goal.target.x_m, goal.target.y_m)]
        for waypoint in request.upcoming[: LONGEST_WAY - 1]:
            try:
                place = float(waypoint.x_m), float(waypoint.y_m)
            except KeyboardInterrupt:
                raise
            except BaseException:  # noqa: BLE001 - they are the AC's own objects
                break
            if not all(-MAX_COORDINATE_M <= each <= MAX_COORDINATE_M for each in place):
                break
            places.append(place)
        self._note(RecordedWay(goal.sent_s, self._robot_id, places))

    def _message(self, goal: Goal) -> GoalEvent:
        target = goal.target
        ended = goal.status is not GoalStatus.ACTIVE
        return GoalEvent(
            goal.sent_s if goal.ended_s is None else goal.ended_s, self._robot_id, goal.id, goal.by.value,
            goal.status.value, float(target.x_m), float(target.y_m), float(target.z_m),
            UNSET if target.heading_rad is None else float(target.heading_rad),
            UNSET if target.speed_m_s is None else float(target.speed_m_s),
            goal.reason if ended else "",
        )  # fmt: skip


class PeerTap:
    """A `RemotePeer` that records another one. Its answers at a tick are fixed when `sample` is called."""

    def __init__(self, inner: RemotePeer, robot_ids: Sequence[int]) -> None:
        self.robot_id = inner.robot_id
        self._inner: Final = inner
        self._robot_ids: Final = tuple(robot_ids)
        self._sample: Sample | None = None
        self._heard: dict[int, float] = {}
        self._needs_charge = False
        self._found: BrokenAssumption | None = None

    def sample(self) -> Sample | None:
        inner = self._inner
        self._sample, self._found = inner.sample(), inner.found()
        self._heard = {robot_id: inner.heard_of(robot_id) for robot_id in self._robot_ids}
        self._needs_charge = inner.needs_charge()
        return self._sample

    def heard_of(self, robot_id: int) -> float:
        return self._heard.get(robot_id, -math.inf)

    def needs_charge(self) -> bool:
        return self._needs_charge

    def found(self) -> BrokenAssumption | None:
        return self._found

    def message(self, now_s: float) -> PeerEvent:
        """Return the peer's answers at the tick at `now_s`, as an event."""
        sample, found = self._sample, self._found
        assert sample is None or isinstance(sample, RobotState)
        return PeerEvent(
            now_s,
            self.robot_id,
            UNSET if sample is None else state_of(sample),
            tuple(
                HeardMessage(robot_id, stamp_s) for robot_id, stamp_s in self._heard.items() if math.isfinite(stamp_s)
            ),
            self._needs_charge,
            "" if found is None else found.assumption.id,
            "" if found is None else found.cause,
        )

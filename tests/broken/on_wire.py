"""Adapters behind a link, each wrong in one way; the docstring says how, `caught_by` which clause must find out."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from soter.sdk import Capabilities, Controller, Goal, GoalStatus, RobotState
from tests.conformance.wire import Intent, Vehicle, WireRobot


class BrokenWire(WireRobot):
    """The adapter behind a link, ready to be broken."""

    caught_by: ClassVar[str]


class SuccessOnLostLink(BrokenWire, overrides=("read_state",)):
    """Counts silence as success: a goal that was sent long enough ago is reached."""

    caught_by = "link.no_success"
    _sent: Goal | None = None

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        self._sent = goal

    def read_state(self) -> RobotState:
        state, now_s = super().read_state(), self.clock.now()
        if self._sent is not None and now_s - state.stamp_s > 1.0:
            self._sent._end(GoalStatus.REACHED, "no news", now_s)
        return state


class RestampedOnRead(BrokenWire):
    """Stamps the latest sample with the time at which it is read."""

    caught_by = "link.age"

    def _sample(self) -> RobotState | None:
        state = super()._sample()
        return None if state is None else state._replace(stamp_s=self.clock.now())


class StampedOnArrival(BrokenWire):
    """Stamps samples with the time at which they arrive."""

    caught_by = "link.delay"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._stamped: tuple[float, RobotState] | None = None

    def _sample(self) -> RobotState | None:
        state = super()._sample()
        if state is None:
            return None
        if self._stamped is None or self._stamped[0] != state.vehicle_stamp_s:
            self._stamped = state.vehicle_stamp_s, state._replace(stamp_s=self.clock.now())
        return self._stamped[1]


class NoLease(Vehicle):
    lease_s = math.inf


class LeaseOnTheWrongSide(BrokenWire):
    """Keeps the lease in SOTER's process: a vehicle that hears nothing drives on."""

    caught_by = "link.stops"
    vehicle_class = NoLease

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._renewed_s = -math.inf

    def _renew_lease(self) -> None:
        self._renewed_s = self.clock.now()
        super()._renew_lease()

    def _sample(self) -> RobotState | None:
        if self.wanted.goal is not None and self.clock.now() - self._renewed_s > 0.2:
            self.want(goal=None)
        return super()._sample()


class NeverReconnects(BrokenWire):
    """Gives a link up for good once it was silent for a second."""

    caught_by = "link.reconnects"

    def _sample(self) -> RobotState | None:
        if self.latest is not None and self.clock.now() - self.latest.stamp_s > 1.0:
            return self.latest
        return super()._sample()


class OneSocketForAll(BrokenWire):
    """Blocks all robots while one of them is silent."""

    caught_by = "link.one_of_two"
    _silent: ClassVar[dict[int, bool]] = {}

    def _connect(self, timeout_s: float) -> Capabilities:
        self._silent[self.id] = False
        return super()._connect(timeout_s)

    def want(self, *, renew: bool = False, **changes: Goal | Controller | None) -> None:
        self._silent[self.id] = self.faults.cut
        if not any(self._silent.values()):
            super().want(renew=renew, **changes)

    def _disconnect(self, timeout_s: float) -> None:
        self._silent.clear()
        super()._disconnect(timeout_s)


class OnlyRenews(Vehicle):
    def take(self, intent: Intent, clock_s: float) -> None:
        if intent.renews and intent.session == self.session and intent.number > self.heard:
            self.heard = intent.number
            self.renew(intent, clock_s)
            return
        super().take(intent, clock_s)


class SaysItOnce(BrokenWire):
    """Sends a hand-over once, and in renewals says nothing of who is in charge."""

    caught_by = "link.switch_is_not_lost"
    vehicle_class = OnlyRenews


class TakesAll(Vehicle):
    def take(self, intent: Intent, clock_s: float) -> None:
        self.session = intent.session
        if intent.renews:
            self.renew(intent, clock_s)
            return
        self.mux.switch(intent.in_charge)
        if intent.goal is None:
            self.mux.halt()
        else:
            self.mux.give(intent.in_charge, intent.goal, clock_s)


class Unnumbered(BrokenWire):
    """Executes gotos whenever they arrive, after a later stop or switch too."""

    caught_by = "link.reorder"
    vehicle_class = TakesAll


class TogglingVehicle(Vehicle):
    def take(self, intent: Intent, clock_s: float) -> None:
        again, old = intent.number == self.heard, intent.number < self.heard
        self.session, self.heard = intent.session, max(self.heard, intent.number)
        if intent.renews:
            self.renew(intent, clock_s)
        elif not old:
            self.mux.switch(intent.in_charge)
            if intent.goal is None or again:
                self.mux.halt()
            else:
                self.mux.give(intent.in_charge, intent.goal, clock_s)


class Toggles(BrokenWire):
    """Starts with a goto and stops when the same one comes again."""

    caught_by = "link.duplicate"
    vehicle_class = TogglingVehicle


class OldestFirst(BrokenWire, overrides=("read_state",)):
    """Takes samples in the order in which they arrive, older ones too."""

    caught_by = "link.reorder"

    def _sample(self) -> RobotState | None:
        for sample in self.up.receive(self.clock.now()):
            self.learned.observe(self.id, sample.vehicle_stamp_s, self.arrived_s(sample))
            self.latest = sample._replace(stamp_s=self.learned.to_fleet_s(self.id, sample.vehicle_stamp_s))
        return self.latest

    def read_state(self) -> RobotState:
        state = super().read_state()
        return state if self.latest is None else self.latest._replace(link=state.link)

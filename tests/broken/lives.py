"""Adapters in process that are wrong about who may move a robot, and for how long."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from soter.errors import LifecycleError
from soter.onboard.mux import Mux
from soter.sdk import Capabilities, Controller, Goal, RobotState, Switch, Waypoint
from tests.broken.in_process import Broken, not_cancelled


class DeathIgnored(Broken):
    """Repeats the last set-point for ever: there is no lease on the vehicle."""

    caught_by = "deadman.silence"

    def _renew_lease(self) -> None:
        self._mux.renew(self._world.now_s)
        self._mux.lease_s = math.inf


class LeaseByTimer(Broken):
    """Renews the lease from a timer of its own."""

    caught_by = "deadman.silence"

    def _connect(self, timeout_s: float) -> Capabilities:
        honest = self._vehicle.control

        def control(*state: float) -> tuple[float, float]:
            self._mux.renew(state[0])
            return honest(*state)

        found = super()._connect(timeout_s)
        self._world.set_control(self.id, control)
        return found


class ReadRenews(Broken):
    """Takes any traffic for a sign of life, reading the state too."""

    caught_by = "deadman.reading"

    def _sample(self) -> RobotState:
        self._mux.renew(self._world.now_s)
        return self._honest()


class GotoRenews(Broken):
    """Renews the lease with every goto, so that a runaway controller keeps itself alive."""

    caught_by = "deadman.goto"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        self._mux.renew(self._world.now_s)


class LeaseTooShort(Broken):
    """Stops between two renewals: its lease is shorter than declared."""

    caught_by = "deadman.kept_alive"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._mux.lease_s = 0.04

    def _renew_lease(self) -> None:
        if round(self._world.now_s / self._world.period_s) % 3 == 0:
            self._mux.renew(self._world.now_s)


class StaysDead(Broken):
    """Never moves again once its lease has died."""

    caught_by = "deadman.recovers"

    def _renew_lease(self) -> None:
        now_s = self._world.now_s
        # Long after the last renewal, where there was one.
        if not now_s - self._mux._renewed_s > 0.5 or self._mux._renewed_s < 0.0:
            self._mux.renew(now_s)


class NothingFlushed(Broken):
    """Hands over and leaves the old controller's target in force."""

    caught_by = "authority.flushes"

    def _hand_over(self, to: Controller) -> None:
        self._mux.in_charge = to


class LateHandOver(Broken):
    """Hands over half a second later."""

    caught_by = "authority.flushes"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._pending: tuple[float, Controller] | None = None

    def _hand_over(self, to: Controller) -> None:
        self._pending = (self._world.now_s + 0.5, to)

    def _sample(self) -> RobotState:
        if self._pending is not None and self._world.now_s >= self._pending[0]:
            self._mux.switch(self._pending[1])
            self._pending = None
        return self._honest()


class RenewalFlushes(Broken, overrides=("switch_ac_sc",)):
    """Flushes the target with every switch, to the controller in charge too."""

    caught_by = "authority.idempotent"

    def switch_ac_sc(self, to: Controller, reason: str) -> Switch:
        switch = super().switch_ac_sc(to, reason)
        self._mux.halt()
        return switch


class Revives(Broken):
    """Takes up the AC's old target when the AC is back in charge."""

    caught_by = "authority.nothing_revived"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._old: dict[Controller, Goal] = {}

    def _send_goto(self, goal: Goal) -> None:
        self._old[goal.by] = goal
        super()._send_goto(goal)

    def _hand_over(self, to: Controller) -> None:
        super()._hand_over(to)
        if to in self._old:
            self._mux.give(to, self._old[to], self._world.now_s)


class Broadcast(Broken):
    """Sends a goto to every robot on the wire."""

    caught_by = "several.goto"
    _all: ClassVar[list[Broken]] = []

    def _connect(self, timeout_s: float) -> Capabilities:
        self._all.append(self)
        return super()._connect(timeout_s)

    def _send_goto(self, goal: Goal) -> None:
        for robot in self._all:
            if robot._world is self._world:
                offset_x, offset_y = robot.spec.x_m - self.spec.x_m, robot.spec.y_m - self.spec.y_m
                target = goal.target._replace(x_m=goal.target.x_m + offset_x, y_m=goal.target.y_m + offset_y)
                sent = goal if robot is self else Goal(not_cancelled, goal.id, target, goal.by, goal.sent_s)
                robot._mux.give(goal.by, sent, self._world.now_s)

    def _disconnect(self, timeout_s: float) -> None:
        self._all[:] = [robot for robot in self._all if robot is not self]
        super()._disconnect(timeout_s)


class SharedLease(Broken):
    """Renews the lease of the whole fleet with that of one robot."""

    caught_by = "several.lease"
    _muxes: ClassVar[list[Mux[Controller, Goal]]] = []

    def _connect(self, timeout_s: float) -> Capabilities:
        self._muxes.append(self._mux)
        return super()._connect(timeout_s)

    def _renew_lease(self) -> None:
        for mux in self._muxes:
            mux.renew(self._world.now_s)

    def _disconnect(self, timeout_s: float) -> None:
        self._muxes.remove(self._mux) if self._mux in self._muxes else None
        super()._disconnect(timeout_s)


class CloseTakesAll(Broken):
    """Closes what all robots share with the first robot that is closed."""

    caught_by = "several.close"

    def _disconnect(self, timeout_s: float) -> None:
        super()._disconnect(timeout_s)
        self._world.close()


class LeftDriving(Broken):
    """Lets go of the robot while it drives; its last set-point lives on."""

    caught_by = "truth.lifecycle.close_stops"

    def _disconnect(self, timeout_s: float) -> None:
        self._mux.lease_s = math.inf


class ReadyBeforeInit(Broken, overrides=("read_state",)):
    """Hands out samples before init()."""

    caught_by = "lifecycle.before_init"

    def read_state(self) -> RobotState:
        try:
            return super().read_state()
        except LifecycleError:
            return self._honest()


class StartsByItself(Broken):
    """Drives off when it is connected, to a target of an earlier session."""

    caught_by = "lifecycle.init"
    _started = False

    def _hand_over(self, to: Controller) -> None:
        super()._hand_over(to)
        if self.initialised and not self._started:
            self._started = True
            left = Goal(not_cancelled, 0, Waypoint(self.spec.x_m + 0.5, self.spec.y_m), to, 0.0)
            self._mux.give(to, left, self._world.now_s)

"""Adapters in process, each wrong in one way; the docstring says how, `caught_by` which clause must find out."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import Any, ClassVar

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.errors import LifecycleError
from soter.onboard.drive import Drive, DriveLimits
from soter.onboard.mux import Mux
from soter.sdk import Capabilities, Controller, Goal, GoalStatus, RobotState, Switch, Waypoint
from soter_sim import LIMITS


class Broken(SimulatedRobot):
    """The reference adapter, ready to be broken."""

    caught_by: ClassVar[str]

    def _honest(self) -> RobotState:
        return super()._sample()

    def _drive_with(self, limits: DriveLimits) -> None:
        self._vehicle._drive = Drive(limits, self._world.period_s)


def not_cancelled(_goal: Goal) -> None:
    """Do nothing: these goals are the vehicle's own."""


class NedForEnu(Broken):
    """Hands out north and east in the autopilot's order."""

    caught_by = "state.frame"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(x_m=state.y_m, y_m=state.x_m, vx_m_s=state.vy_m_s, vy_m_s=state.vx_m_s)


class YawSign(Broken):
    """Counts headings clockwise."""

    caught_by = "state.heading"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(heading_rad=-state.heading_rad, yaw_rate_rad_s=-state.yaw_rate_rad_s)


class Degrees(Broken):
    """Hands out headings in degrees."""

    caught_by = "state.ranges"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(heading_rad=math.degrees(state.heading_rad))


class Percent(Broken):
    """Hands out the charge in percent."""

    caught_by = "state.ranges"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(battery=100.0 * (state.battery or 0.0))


class BodyFrameVelocity(Broken):
    """Hands out the velocity along the body's axes."""

    caught_by = "state.velocity"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(vx_m_s=math.hypot(state.vx_m_s, state.vy_m_s), vy_m_s=0.0)


class LateSamples(Broken):
    """Hands out what was 0.4 s ago, stamped as of now."""

    caught_by = "bounds.latency"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._past: list[RobotState] = []

    def _sample(self) -> RobotState:
        state = self._honest()
        if not self._past or state.stamp_s > self._past[-1].stamp_s:
            self._past = [*self._past, state][-9:]
        old = self._past[0]
        return old._replace(stamp_s=state.stamp_s, vehicle_stamp_s=state.vehicle_stamp_s, controller=state.controller)


class AgeFrozen(Broken):
    """Takes a sample once a second and stamps it anew whenever it is read."""

    caught_by = "state.fresh"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._kept: RobotState | None = None

    def _sample(self) -> RobotState:
        state = self._honest()
        if self._kept is None or state.vehicle_stamp_s - self._kept.vehicle_stamp_s >= 1.0:
            self._kept = state
        return self._kept._replace(stamp_s=state.stamp_s, controller=state.controller, goal_id=state.goal_id)


class OldSamples(Broken):
    """Queues samples, so that a reader gets ones that are 0.3 s old, honestly stamped."""

    caught_by = "state.age"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._queue: list[RobotState] = []

    def _sample(self) -> RobotState:
        state = self._honest()
        if not self._queue or state.stamp_s > self._queue[-1].stamp_s:
            self._queue = [*self._queue, state][-7:]
        return self._queue[0]


class VehicleClockStands(Broken):
    """Passes on a vehicle stamp that never changes."""

    caught_by = "state.stamps"

    def _sample(self) -> RobotState:
        return self._honest()._replace(vehicle_stamp_s=0.0)


class FutureStamps(Broken):
    """Estimates the vehicle's clock to be ahead, and stamps samples in the future."""

    caught_by = "state.stamps"

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(stamp_s=state.stamp_s + 0.09)


class NoOpStop(Broken):
    """Documents a stop that does nothing."""

    caught_by = "goal.cancel"

    def _halt(self) -> None:
        pass


class CancelIgnored(Broken):
    """Takes cancel() and goes on."""

    caught_by = "goal.cancel"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        goal._cancel = not_cancelled


class CancelStopsAll(Broken):
    """Stops on any cancel(), whichever goal it names."""

    caught_by = "goal.cancel_own"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        cancel = goal._cancel

        def cancel_and_stop(any_goal: Goal) -> None:
            cancel(any_goal)
            self._halt()

        goal._cancel = cancel_and_stop


class EarlyArrival(Broken):
    """Believes the vehicle's own acceptance radius of 0.3 m."""

    caught_by = "goto.radius"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        goal.radius_sq_m2 = 0.3**2


class AcceptedIsReached(Broken):
    """Reports a goal that was accepted as reached."""

    caught_by = "goto.accepted_is_not_reached"

    def _send_goto(self, goal: Goal) -> None:
        super()._send_goto(goal)
        goal._end(GoalStatus.REACHED, "accepted", self.clock.now())


class AnybodyDrives(Broken, overrides=("goto",)):
    """Executes gotos of whoever sends them."""

    caught_by = "goto.not_in_charge"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        goal = super().goto(target, self.in_charge)
        goal.by = by
        return goal


class RejectedIsExecuted(Broken, overrides=("goto",)):
    """Says REJECTED, and sends the goto all the same."""

    caught_by = "goto.not_in_charge"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        goal = super().goto(target, by)
        if goal.status is GoalStatus.REJECTED:
            self._mux.give(self.in_charge, goal, self._world.now_s)
        return goal


class Unchecked(Broken, overrides=("goto",)):
    """Lets any number through."""

    caught_by = "goto.invalid"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        if type(target) is Waypoint and not math.isfinite(target.x_m):
            target = target._replace(x_m=0.0)
        return super().goto(target, by)


class BlockingGoto(Broken, overrides=("goto",)):
    """Returns from goto() when the robot has moved off."""

    caught_by = "goto.returns_at_once"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        goal = super().goto(target, by)
        end_s = self.clock.now() + 0.3
        while goal.active and self.clock.now() < end_s:
            self.renew_lease()
            self.clock.sleep_until(self.clock.now() + 0.05)
            self.read_state()
        return goal


class BlockingRead(Broken, overrides=("read_state",)):
    """Waits for the next sample when the state is read."""

    caught_by = "state.never_waits"

    def read_state(self) -> RobotState:
        self.clock.sleep_until(self.clock.now() + 0.05)
        return super().read_state()


class SpeedCapIgnored(Broken):
    """Drives at its own speed whatever cap a goal has."""

    caught_by = "goto.speed_cap"

    def _send_goto(self, goal: Goal) -> None:
        goal.target = goal.target._replace(speed_m_s=None)
        super()._send_goto(goal)


class HeadingDropped(Broken):
    """Takes a heading to arrive with, and drops it."""

    caught_by = "goto.heading"

    def _send_goto(self, goal: Goal) -> None:
        goal.target = goal.target._replace(heading_rad=None)
        super()._send_goto(goal)


class QueueReplays(Broken):
    """Works off every target it was ever sent, in order."""

    caught_by = "goal.superseded"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._waiting: list[Goal] = []

    def _send_goto(self, goal: Goal) -> None:
        self._waiting.append(goal)

    def _hand_over(self, to: Controller) -> None:
        self._waiting.clear()
        super()._hand_over(to)

    def _halt(self) -> None:
        self._waiting.clear()
        super()._halt()

    def _sample(self) -> RobotState:
        state, now = self._honest(), self._mux.command
        arrived = now is None or math.hypot(now.target.x_m - state.x_m, now.target.y_m - state.y_m) < 0.02
        if arrived and self._waiting:
            goal = self._waiting.pop(0)
            self._mux.give(goal.by, goal, self._world.now_s)
        return state


class DriftsOn(Broken):
    """Creeps on after it has arrived, because the last set-point was a velocity."""

    caught_by = "goto.holds"

    def _connect(self, timeout_s: float) -> Capabilities:
        honest = self._vehicle.control

        def control(*state: float) -> tuple[float, float]:
            speed, rate = honest(*state)
            goal = self._mux.command
            return (0.03, 0.0) if speed == 0.0 and goal is not None and not goal.active else (speed, rate)

        found = super()._connect(timeout_s)
        self._world.set_control(self.id, control)
        return found


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


class MadeUpController(Broken):
    """Reports a controller although the vehicle does not: it declares otherwise."""

    caught_by = "capabilities.optional"
    declared: ClassVar[Capabilities] = replace(SimulatedRobot.declared, reports_controller=False)


class EndlessLease(Broken):
    """Declares a lease without end."""

    caught_by = "capabilities.sane"
    declared: ClassVar[Capabilities] = replace(SimulatedRobot.declared, lease_s=math.inf)


class Unseeded(Broken):
    """Declares to be deterministic and adds noise from the operating system."""

    caught_by = "capabilities.deterministic"
    _noise: ClassVar[random.SystemRandom] = random.SystemRandom()

    def _sample(self) -> RobotState:
        state = self._honest()
        return state._replace(x_m=state.x_m + self._noise.uniform(-1e-6, 1e-6))


class AltitudeDropped(Broken, overrides=("goto",)):
    """Says that a goal above the ground is reached from the ground."""

    caught_by = "capabilities.unsupported"

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        return super().goto(target._replace(z_m=0.0) if type(target) is Waypoint else target, by)


class WeakBrakes(Broken):
    """Brakes at a third of what it declares."""

    caught_by = "bounds.braking"
    declared: ClassVar[Capabilities] = replace(SimulatedRobot.declared, brake_m_s2=3.0, latency_s=0.0)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._drive_with(LIMITS)


class Curved(Broken):
    """Drives a curve where it declares a straight segment."""

    caught_by = "bounds.tube"

    def _connect(self, timeout_s: float) -> Capabilities:
        honest = self._vehicle.control

        def control(*state: float) -> tuple[float, float]:
            speed, rate = honest(*state)
            return speed, rate + (0.6 if speed > 0.1 else 0.0)

        found = super()._connect(timeout_s)
        self._world.set_control(self.id, control)
        return found


class FasterThanDeclared(Broken):
    """Declares less than its top speed and clamps nothing."""

    caught_by = "goto.v_max"
    declared: ClassVar[Capabilities] = replace(SimulatedRobot.declared, v_max_m_s=0.15)


class OthersIds(Broken):
    """Takes the samples of whichever robot has sent last."""

    caught_by = "several.ids"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._index = len(self._world.bodies.ids) - 1


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

"""One velocity-controlled robot, behind a mux beside its base: the common part of all such adapters."""

from __future__ import annotations

import logging
import secrets
import threading
import time
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable
from math import inf
from typing import Any, ClassVar, Final, NamedTuple

from soter.adapters.velocity_controlled.motion import Charge, MeasuredMotion, Pose, read_battery, read_odometry
from soter.clock import VehicleClock
from soter.errors import Intruder, Unsupported
from soter.onboard.drive import OVERSHOOT_M, TUBE_M, Drive, DriveLimits
from soter.onboard.gate_node import PERIOD_S
from soter.onboard.wire import SC, GateReport, Order
from soter.sdk import Capabilities, Controller, Goal, Link, Robot, RobotSpec, RobotState, Waypoint

logger = logging.getLogger(__name__)

LEASE_S: Final = 0.15
"""The mux counts 0.13 s of this by default, because it looks only every 0.02 s."""

ODOMETRY_S: Final = 1.0 / 30.0

SETTLED: Final = 10
"""Number of odometry messages after which the shortest delay among them is near the shortest possible."""

BASE: Final = DriveLimits()
"""The limits of a base, unless others are promised."""

# The drive steers by old samples, and the robot acts later still: so it plans with less than the base can do.
_BRAKE: Final = 0.7
_YAW_ACCEL_RAD_S2: Final = 4.0
_PLANNED_PERIOD_S: Final = 0.1
_REACTION_S: Final = 0.03
_BLIND_S: Final = 0.3

_LOOK_S: Final = 0.005
_ASK_S: Final = 0.25
_REPEAT_S: Final = 0.05
_LOST_S: Final = 1.0
_GAP_S: Final = 0.25
"""A longer gap between two samples is the link's silence, not the mux's."""

_INTRUDED_S: Final = 0.1
"""How long a robot's lease is not renewed after another program was seen to drive it: one message stops the robot for
a tick or two, and a stream of messages keeps it stopped."""


def wait_for(holds: Callable[[], bool], timeout_s: float) -> bool:
    """Wait until other threads have made a condition true; return whether they have in time."""
    until_s = time.monotonic() + timeout_s
    while not holds():
        if time.monotonic() >= until_s:
            return False
        time.sleep(_LOOK_S)
    return True


class _Doing(NamedTuple):
    """The robot's present task; replaced as a whole by the supervisor's thread, read by the receiving thread."""

    controller: str
    target: Waypoint | None
    goal_id: int | None
    renewed_steady_s: float


class VelocityControlledRobot(Robot):
    """One robot behind a mux.

    The thread that receives odometry also steers: at each message it sends the next velocity for the goal, as the
    active controller, as long as the lease lives, which only the supervisor renews.

    An adapter hands on messages by the `_take_...` methods, each kind from one thread at a time, and implements
    `_send_velocity`, `_send_order` and, of Robot's hooks, `_connect`.

    Args:
        spec: the robot.
        clock: follows the robots' clocks.
        origin: the pose in the workspace at which its odometry reads 0, 0, 0.
        rate: seconds of the robot's clock per host second; above 1 only in a simulated world that runs faster.
        external_ac: whether the AC is a program outside SOTER that sends to the mux itself; SOTER never sends for it.

    Attributes:
        dropped: how many messages were dropped, by cause.
    """

    declared: ClassVar[Capabilities] = Capabilities(
        in_process=False,
        deterministic=False,
        reverses=True,
        reports_battery=True,
        reports_controller=True,
        v_max_m_s=BASE.v_max_m_s,
        yaw_rate_max_rad_s=BASE.yaw_rate_max_rad_s,
        brake_m_s2=BASE.brake_m_s2,
        body_radius_m=0.105,
        latency_s=0.045,
        sample_age_s=0.07,
        jitter_s=0.028,
        setpoint_period_s=ODOMETRY_S,
        lease_s=LEASE_S,
        tube_m=TUBE_M,
        overshoot_m=OVERSHOOT_M,
        # Stamps move by some milliseconds while clocks are being learned; this is the distance at top speed.
        position_noise_m=0.002,
        pivots_first=True,
    )

    def __init__(
        self,
        spec: RobotSpec,
        clock: VehicleClock,
        origin: Pose = (0.0, 0.0, 0.0),
        *,
        rate: float = 1.0,
        external_ac: bool = False,
    ) -> None:
        super().__init__(spec, clock)
        self._vehicle_clock: Final = clock
        self._origin: Final = origin
        self._external_ac: Final = external_ac
        self._rate: Final = rate
        promised = self.declared
        limits = DriveLimits(
            promised.v_max_m_s, promised.yaw_rate_max_rad_s, brake_m_s2=_BRAKE * promised.brake_m_s2,
            yaw_accel_rad_s2=_YAW_ACCEL_RAD_S2, speed_noise_m_s=promised.speed_noise_m_s or 0.0,
            position_noise_m=promised.position_noise_m,
        )  # fmt: skip
        self._drive: Final = Drive(limits, _PLANNED_PERIOD_S * rate)
        self._steering: Final = threading.Lock()
        self._doing = _Doing(SC, None, None, float("-inf"))
        self._order = Order(secrets.token_hex(4), 0, SC, None)
        self._latest: tuple[RobotState, MeasuredMotion] | None = None
        self._gate: GateReport | None = None
        self._reported: Charge | None = None
        self._charge: Charge | None = None
        # When the charge was reported, in host time: the robot's own clock may be set meanwhile.
        self._charged_s = -inf
        # How long the robot has been heard since the oldest order that its mux has not answered; None without one.
        self._unanswered_s: float | None = None
        self._heard = 0
        self._intruded = float("-inf"), ""
        self.dropped: Final[Counter[str]] = Counter()

    @staticmethod
    def counted_s(promised: Capabilities) -> float:
        """Return the lease that a mux counts: with the mux's own period, it is as long as promised."""
        return promised.lease_s - PERIOD_S

    # --- what an adapter hears -----------------------------------------------------------------------------

    def _take_odometry(self, message: Any) -> None:
        """Take a nav_msgs/Odometry, and steer by it."""
        received_s = self.clock.steady_s()
        motion = read_odometry(message, self._origin)
        if not motion.possible:
            self._drop("odometry that is not finite", motion)
            return
        latest = self._latest
        rebooted = self._vehicle_clock.observe(self.id, motion.stamp_s, received_s)
        if latest is not None and motion.stamp_s < latest[1].stamp_s and not rebooted:
            # A newer message has overtaken this one.
            return
        east_m_s, north_m_s = motion.velocity
        gate = self._gate
        if (reported := self._reported) is not None:
            age_s = max(0.0, motion.stamp_s - reported.stamp_s) / self._rate
            charged_s = received_s - age_s
            if self._charge is not None and reported.stamp_s >= self._charge.stamp_s:
                # It is no older than the one before it, even if the clock was set while it was on its way.
                charged_s = max(charged_s, self._charged_s)
            self._reported, self._charge, self._charged_s = None, reported, charged_s
        driven_s = self._rate * (received_s - self._charged_s)
        unanswered_s = self._unanswered_s
        if unanswered_s is not None and latest is not None:
            passed_s = max(0.0, motion.stamp_s - latest[1].stamp_s) / self._rate
            self._unanswered_s = unanswered_s = unanswered_s + min(passed_s, _GAP_S)
        # A mux's active controller counts only while the mux is alive and follows our orders.
        ours = gate is not None and gate.session == self._order.session and (unanswered_s or 0.0) <= _LOST_S
        state = RobotState(
            robot_id=self.id,
            stamp_s=self._vehicle_clock.to_fleet_s(self.id, motion.stamp_s),
            vehicle_stamp_s=motion.stamp_s,
            x_m=motion.x_m,
            y_m=motion.y_m,
            z_m=0.0,
            heading_rad=motion.heading_rad,
            vx_m_s=east_m_s,
            vy_m_s=north_m_s,
            yaw_rate_rad_s=motion.turn_rad_s,
            # Batteries report seldom. In between the robot counts as driving: the next report can only be higher.
            battery=None if self._charge is None else max(0.0, self._charge.level - driven_s / self.spec.drive_s),
            controller=Controller(gate.controller) if gate is not None and ours else None,
            goal_id=self._doing.goal_id,
            link=Link.UP,
        )
        self._latest = (state, motion)
        self._heard += 1
        self._steer()

    def _take_battery(self, message: Any) -> None:
        """Take a sensor_msgs/BatteryState."""
        charge = read_battery(message)
        if charge is None:
            self._drop("a charge that is none", message.percentage)
        else:
            self._reported = charge

    def _take_report(self, text: str) -> None:
        """Take a report of the mux."""
        try:
            self._gate = GateReport.decode(text)
            self._unanswered_s = None
        except ValueError as failure:
            self._drop("a report of its mux that makes no sense", failure)

    def _take_intruder(self, why: str) -> None:
        """Note that another program has just moved the robot, or may at any time."""
        if not self._intruded[1]:
            logger.warning("robot %d: %s", self.id, why)
        self._intruded = self.clock.steady_s(), why

    def _drop(self, what: str, why: object) -> None:
        """Count a dropped message, and log only the first of its kind: there may be many."""
        self.dropped[what] += 1
        if self.dropped[what] == 1:
            logger.warning("robot %d: dropped %s: %s", self.id, what, why)

    # --- what an adapter says ------------------------------------------------------------------------------

    @abstractmethod
    def _send_velocity(self, by: str, forward_m_s: float, turn_rad_s: float) -> None:
        """Send a velocity to the mux as a controller, without waiting. Called from any thread."""

    @abstractmethod
    def _send_order(self, text: str) -> None:
        """Send an order to the mux, without waiting. Called from the supervisor's thread."""

    # --- the hooks of Robot --------------------------------------------------------------------------------

    def _send_goto(self, goal: Goal) -> None:
        if not self._speaks_for(goal.by.value):
            raise Unsupported(f"robot {self.id}: its AC is another program, and SOTER sends nothing in its name")
        self._doing = self._doing._replace(target=goal.target, goal_id=goal.id)
        self._steer()

    def _sample(self) -> RobotState | None:
        latest = self._latest
        return None if latest is None else latest[0]

    def _hand_over(self, to: Controller) -> None:
        # One message stops the old controller: at a switch the mux drops that controller's velocity.
        if to.value != self._doing.controller:
            self._doing = self._doing._replace(controller=to.value, target=None, goal_id=None)
        self._say(controller=to.value)

    def _renew_lease(self) -> None:
        clock = self._vehicle_clock
        seen_s, why = self._intruded
        if clock.steady_s() - seen_s < _INTRUDED_S:
            raise Intruder(why)
        self._doing = self._doing._replace(renewed_steady_s=clock.steady_s())
        self._say(renewed_s=clock.to_vehicle_s(self.id, clock.now()))

    def _halt(self) -> None:
        self._doing = self._doing._replace(target=None, goal_id=None)
        self._steer()

    def _disconnect(self, timeout_s: float) -> None:
        if not self.initialised:
            return
        self._doing = _Doing(SC, None, None, float("-inf"))
        self._order = self._order._replace(controller=SC, renewed_s=None)
        first = self._order.seq + 1
        if self._settle(min(timeout_s, _LOST_S)):
            return
        # A robot or a mux that is no longer heard has been stopped by its lease; few of them come back, so do not wait.
        latest = self._latest
        heard = latest is not None and self.clock.now() - latest[0].stamp_s <= self.stale_after_s
        if heard and self._has_taken(first):
            self._settle(timeout_s - _LOST_S)

    # --- for an adapter's `_connect` -----------------------------------------------------------------------

    def _say(self, **changes: object) -> None:
        """Send the whole order with these changes, under a new number."""
        order = self._order._replace(seq=self._order.seq + 1, **changes)  # type: ignore[arg-type]
        self._order = order
        if self._unanswered_s is None:
            self._unanswered_s = 0.0
        self._send_order(order.encode())

    def _discover(self, timeout_s: float, *, battery: bool) -> bool:
        """Wait until every kind of the robot's messages has been heard; return whether all come in time."""
        until_s = self.clock.steady_s() + timeout_s
        while self.clock.steady_s() < until_s:
            # Without a lease, so that nothing moves. A ROS mux whose last report got lost reports only after an order.
            self._say()
            if wait_for(lambda: self._all_heard(battery=battery), min(_ASK_S, until_s - self.clock.steady_s())):
                return True
        return False

    def _all_heard(self, *, battery: bool) -> bool:
        """Return whether the clock is known well enough and the mux has reported, and the battery if required."""
        return self._heard >= SETTLED and self._gate is not None and (self._charge is not None or not battery)

    def _settle(self, timeout_s: float) -> bool:
        """Repeat the order until the mux has taken it and the robot is at rest; return whether both come in time."""
        first, until_s = self._order.seq + 1, self.clock.steady_s() + timeout_s

        def done() -> bool:
            latest = self._latest
            return latest is not None and self._has_taken(first) and self.declared.rests(latest[0])

        while self.clock.steady_s() < until_s:
            self._say()
            if wait_for(done, _REPEAT_S):
                return True
        return False

    def _has_taken(self, first: int) -> bool:
        """Return whether the mux has taken one of our orders with this number or a later one."""
        gate = self._gate
        return gate is not None and gate.session == self._order.session and gate.seq >= first

    def _follows_another(self) -> bool:
        """Return whether the mux reports that another program's lease lives."""
        gate = self._gate
        return gate is not None and gate.session not in {"", self._order.session} and gate.alive

    def _refusal(self) -> str | None:
        """Return why the robot did not settle, by its mux's report; None if its mux takes no order of ours."""
        gate, latest = self._gate, self._latest
        if self._follows_another():
            return "its mux follows another program, whose lease lives; end that program"
        if gate is not None and gate.session == self._order.session and latest is not None:
            return self.declared.unrest(latest[0])
        return None

    def _speaks_for(self, controller: str) -> bool:
        return controller == SC or not self._external_ac

    def _steer(self) -> None:
        """Send the active controller's velocity for now; nothing once the lease is dead."""
        with self._steering:
            doing, latest = self._doing, self._latest
            lease_age_s = (self.clock.steady_s() - doing.renewed_steady_s) * self._rate
            if latest is None or not self._speaks_for(doing.controller) or lease_age_s >= self.declared.lease_s:
                return
            gate = self._gate
            if gate is not None and gate.session not in {"", self._order.session}:
                # The mux would take our velocity for that of the other program's controller.
                return
            age_s = self.clock.now() - latest[0].stamp_s
            if age_s > _BLIND_S:
                velocity = 0.0, 0.0
            else:
                # The motion at the moment when the robot acts on the velocity.
                motion = latest[1].after(age_s + _REACTION_S * self._rate)
                velocity = self._drive.command(
                    motion.x_m, motion.y_m, motion.heading_rad, motion.forward_m_s, motion.turn_rad_s, doing.target
                )
            self._send_velocity(doing.controller, *velocity)

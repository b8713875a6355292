"""One ROS 2 robot behind the narrow interface."""

from __future__ import annotations

import logging
import secrets
import threading
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

from soter.adapters.ros2.options import Ros2Config
from soter.clock import VehicleClock
from soter.drive import OVERSHOOT_M, TUBE_M, Drive, DriveLimits
from soter.errors import RobotUnavailable, Unsupported
from soter.mux.wire import AC, SC, GateReport, Order
from soter.sdk import Capabilities, Controller, Goal, Link, Robot, RobotSpec, RobotState, Waypoint

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import BatteryState
    from std_msgs.msg import String

    # Imported where they are used: what a robot promises can be read where ROS is not installed.
    from soter.adapters.ros2.graph import Graph
    from soter.adapters.ros2.messages import Charge, Motion

logger = logging.getLogger(__name__)

LEASE_S: Final = 0.15
"""Of this the mux counts 0.13 s; it looks every 0.02 s."""

ODOMETRY_S: Final = 1.0 / 30.0

# It steers by what it knows of the robot, which acts on that later: so it plans with less than the vehicle can do.
_LIMITS: Final = DriveLimits(brake_m_s2=0.7, yaw_accel_rad_s2=4.0)
_PLANNED_PERIOD_S: Final = 0.1
_REACTION_S: Final = 0.03
_BLIND_S: Final = 0.3

_SETTLED: Final = 10
"""After so many odometry messages the least delay among them is near the least there is."""

_REPEAT_S: Final = 0.05
_LOST_S: Final = 1.0
_REST_M_S: Final = 1e-3
_REST_RAD_S: Final = 1e-2
_MUX: Final = "soter_mux"


class _Doing(NamedTuple):
    """What the robot is to do; replaced as a whole by the supervisor's thread, read by the thread that hears ROS."""

    controller: str
    target: Waypoint | None
    goal_id: int | None
    renewed_steady_s: float


class Ros2Robot(Robot):
    """One robot in a namespace of the ROS graph.

    Odometry is heard in the graph's thread, which also steers: at each message it publishes the next velocity for the
    goal, on the topic of the controller in charge, as long as the lease lives that only the supervisor renews.

    Args:
        spec: which robot.
        clock: follows the robots' clocks.
        ros: SOTER's corner of the graph.
        config: of the backend, with this robot in it.
        external_ac: its AC is somebody else's node, which publishes on `cmd_vel_ac`: this robot never does.
    """

    declared: ClassVar[Capabilities] = Capabilities(
        in_process=False,
        deterministic=False,
        reverses=True,
        reports_battery=True,
        reports_controller=True,
        v_max_m_s=_LIMITS.v_max_m_s,
        yaw_rate_max_rad_s=_LIMITS.yaw_rate_max_rad_s,
        brake_m_s2=1.0,
        body_radius_m=0.105,
        latency_s=0.045,
        sample_age_s=0.07,
        jitter_s=0.028,
        setpoint_period_s=ODOMETRY_S,
        lease_s=LEASE_S,
        tube_m=TUBE_M,
        overshoot_m=OVERSHOOT_M,
        # Stamps move by some milliseconds while clocks are learned; at top speed that is this far.
        position_noise_m=0.002,
        pivots_first=True,
    )

    def __init__(
        self, spec: RobotSpec, clock: VehicleClock, ros: Graph, config: Ros2Config, *, external_ac: bool = False
    ) -> None:
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import BatteryState
        from std_msgs.msg import String

        from soter.adapters.ros2 import graph
        from soter.adapters.ros2.messages import velocity_type

        super().__init__(spec, clock)
        place, topics = config.robots[spec.id], config.topics
        self._vehicle_clock: Final = clock
        self._ros: Final = ros
        self._config: Final = config
        self._origin: Final = place.odom_origin
        self.node: Final = ros.node(place.namespace)
        self._drive: Final = Drive(_LIMITS, _PLANNED_PERIOD_S)
        self._steering: Final = threading.Lock()
        self._doing = _Doing(SC, None, None, float("-inf"))
        self._order = Order(secrets.token_hex(4), 0, SC, None)
        self._latest: tuple[RobotState, Motion] | None = None
        self._gate: GateReport | None = None
        self._charge: Charge | None = None
        self._heard = 0
        node, velocity = self.node, velocity_type(stamped=config.stamped)
        self._velocities: Final = {SC: node.create_publisher(velocity, topics.cmd_vel_sc, graph.COMMAND)}
        if not external_ac:
            self._velocities[AC] = node.create_publisher(velocity, topics.cmd_vel_ac, graph.COMMAND)
        self._orders: Final = node.create_publisher(String, topics.order, graph.LATCHED)
        node.create_subscription(String, topics.gate, self._hear_gate, graph.LATCHED)
        if topics.battery:
            node.create_subscription(BatteryState, topics.battery, self._hear_battery, graph.SENSOR)
        node.create_subscription(Odometry, topics.odom, self._hear_odometry, graph.SENSOR)

    # --- the graph's thread --------------------------------------------------------------------------------

    def _hear_odometry(self, message: Odometry) -> None:
        from soter.adapters.ros2.messages import read_odometry

        received_s = self.clock.steady_s()
        motion = read_odometry(message, self._origin)
        if not all(map(isfinite, motion)):
            logger.warning("robot %d: dropped odometry that is not finite", self.id)
            return
        latest = self._latest
        rebooted = self._vehicle_clock.observe(self.id, motion.stamp_s, received_s)
        if latest is not None and motion.stamp_s < latest[1].stamp_s and not rebooted:
            # It was overtaken on its way.
            return
        east_m_s, north_m_s = motion.velocity
        gate, charge = self._gate, self._charge
        # What a mux says of who is in charge is about us only if it listens to us.
        ours = gate is not None and gate.session == self._order.session
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
            # Batteries report seldom. In between it counts as driving, so that the next report can only be better news.
            battery=None if charge is None else charge.at_least(motion.stamp_s, 1.0 / self.spec.drive_s),
            controller=Controller(gate.controller) if gate is not None and ours else None,
            goal_id=self._doing.goal_id,
            link=Link.UP,
        )
        self._latest = (state, motion)
        self._heard += 1
        self._steer()

    def _hear_battery(self, message: BatteryState) -> None:
        from soter.adapters.ros2.messages import read_battery

        charge = read_battery(message)
        if charge is None:
            logger.warning("robot %d: dropped a charge of %s", self.id, message.percentage)
        else:
            self._charge = charge

    def _hear_gate(self, message: String) -> None:
        try:
            self._gate = GateReport.decode(message.data)
        except ValueError as failure:
            logger.warning("robot %d: dropped a report of its mux that makes no sense: %s", self.id, failure)

    # --- either thread -------------------------------------------------------------------------------------

    def _steer(self) -> None:
        """Publish the velocity that the controller in charge asks for now; nothing once its lease is dead."""
        from soter.adapters.ros2.messages import make_velocity

        with self._steering:
            doing, latest = self._doing, self._latest
            publisher = self._velocities.get(doing.controller)
            now_s = self.clock.steady_s()
            if publisher is None or latest is None or now_s - doing.renewed_steady_s >= LEASE_S:
                return
            age_s = self.clock.now() - latest[0].stamp_s
            if age_s > _BLIND_S:
                velocity = 0.0, 0.0
            else:
                # Where it will be when it acts on this.
                motion = latest[1].after(age_s + _REACTION_S)
                velocity = self._drive.command(
                    motion.x_m, motion.y_m, motion.heading_rad, motion.forward_m_s, motion.turn_rad_s, doing.target
                )
            stamped = self._config.stamped
            stamp: Any = self.node.get_clock().now().to_msg() if stamped else None
            publisher.publish(make_velocity(*velocity, stamp, stamped=stamped))

    # --- the hooks -----------------------------------------------------------------------------------------

    def _connect(self, timeout_s: float) -> Capabilities:
        clock, ros = self.clock, self._ros
        until_s = clock.steady_s() + timeout_s
        if not ros.wait_for(self._all_heard, min(timeout_s, self._config.discovery_s)):
            raise RobotUnavailable(f"robot {self.id} at {self.node.get_namespace()}: {self._missing()}")
        self._refuse_others(until_s - clock.steady_s())
        if not self._settle(until_s - clock.steady_s()):
            raise RobotUnavailable(f"robot {self.id} at {self.node.get_namespace()}: {self._refusal()}")
        return replace(self.declared, reports_battery=bool(self._config.topics.battery))

    def _send_goto(self, goal: Goal) -> None:
        if goal.by.value not in self._velocities:
            raise Unsupported(f"robot {self.id}: its AC is somebody else's node, and is not spoken for")
        self._doing = self._doing._replace(target=goal.target, goal_id=goal.id)
        self._steer()

    def _sample(self) -> RobotState | None:
        latest = self._latest
        return None if latest is None else latest[0]

    def _hand_over(self, to: Controller) -> None:
        # One message shuts the old controller's stream: the mux drops what it asked for with the change.
        self._doing = self._doing._replace(controller=to.value, target=None, goal_id=None)
        self._say(controller=to.value)

    def _renew_lease(self) -> None:
        clock = self._vehicle_clock
        self._doing = self._doing._replace(renewed_steady_s=clock.steady_s())
        self._say(renewed_s=clock.to_vehicle_s(self.id, clock.now()))

    def _halt(self) -> None:
        self._doing = self._doing._replace(target=None, goal_id=None)
        self._steer()

    def _disconnect(self, timeout_s: float) -> None:
        if self._capabilities is None:
            return
        self._doing = _Doing(SC, None, None, float("-inf"))
        self._order = self._order._replace(controller=SC, renewed_s=None)
        latest = self._latest
        lost = latest is None or self.clock.now() - latest[0].stamp_s > self.stale_after_s
        # Who is not heard any more has been stopped by its lease; it may still come back, but not many do.
        self._settle(min(timeout_s, _LOST_S) if lost else timeout_s)

    # --- the rest ------------------------------------------------------------------------------------------

    def _say(self, **changes: object) -> None:
        """Tell the mux all that is to hold, with these changes, under a new number."""
        from std_msgs.msg import String

        order = self._order._replace(seq=self._order.seq + 1, **changes)  # type: ignore[arg-type]
        self._order = order
        self._orders.publish(String(data=order.encode()))

    def _settle(self, timeout_s: float) -> bool:
        """Repeat the order until the mux has taken it and the robot stands still; return whether that is so in time."""
        first, until_s = self._order.seq + 1, self.clock.steady_s() + timeout_s

        def done() -> bool:
            gate, latest = self._gate, self._latest
            if gate is None or latest is None or gate.session != self._order.session or gate.seq < first:
                return False
            motion = latest[1]
            return (
                abs(motion.forward_m_s) + abs(motion.leftward_m_s) <= _REST_M_S
                and abs(motion.turn_rad_s) <= _REST_RAD_S
            )

        while self.clock.steady_s() < until_s:
            self._say()
            if self._ros.wait_for(done, _REPEAT_S):
                return True
        return False

    def _all_heard(self) -> bool:
        battery = self._charge is not None or not self._config.topics.battery
        return self._heard >= _SETTLED and self._gate is not None and battery

    def _missing(self) -> str:
        """Return what was not heard, and why that may be."""
        from soter.adapters.ros2 import graph
        from soter.adapters.ros2.messages import KINDS

        config, node = self._config, self.node
        topics, missing = config.topics, []
        if self._heard < _SETTLED:
            missing += graph.heard_wrongly(node, topics.odom, "nav_msgs/msg/Odometry", graph.SENSOR) or [
                f"{self._heard} messages were heard on {topics.odom}"
            ]
        if self._charge is None and topics.battery:
            missing += graph.heard_wrongly(node, topics.battery, "sensor_msgs/msg/BatteryState", graph.SENSOR) or [
                f"no charge from 0 to 1 was heard on {topics.battery}"
            ]
        if self._gate is None:
            missing += graph.heard_wrongly(node, topics.gate, "std_msgs/msg/String", graph.LATCHED) or [
                f"nothing was heard on {topics.gate}"
            ]
            missing += graph.said_wrongly(node, topics.cmd_vel_sc, KINDS[config.stamped], graph.COMMAND)
        if config.use_sim_time and not graph.publishers(node, "/clock"):
            missing.append("nobody publishes /clock, and use_sim_time is set")
        return (
            f"within {config.discovery_s:g} s: {'; '.join(missing)}. Is the robot running, with `soter ros2-mux` "
            "beside it, and are the namespace, the topics and the ROS domain in [backends.ros2] right?"
        )

    def _refuse_others(self, timeout_s: float) -> None:
        """Refuse a robot that others may drive past the mux, or in the SC's name."""
        from soter.adapters.ros2 import graph
        from soter.adapters.ros2.messages import KINDS

        node, topics = self.node, self._config.topics
        self._ros.wait_for(lambda: graph.all_named(node, topics.cmd_vel, topics.cmd_vel_sc), timeout_s)
        own = f"{node.get_namespace().rstrip('/')}/{graph.NODE_NAME}"
        past = [name for name in graph.publishers(node, topics.cmd_vel) if not name.endswith(f"/{_MUX}")]
        forged = [name for name in graph.publishers(node, topics.cmd_vel_sc) if name != own]
        wrong = graph.said_wrongly(node, topics.cmd_vel_sc, KINDS[self._config.stamped], graph.COMMAND)
        for names, topic, what in (
            (past, topics.cmd_vel, "drive it past the mux"),
            (forged, topics.cmd_vel_sc, "speak for its safe controller"),
        ):
            if names:
                raise RobotUnavailable(
                    f"robot {self.id} at {node.get_namespace()}: {', '.join(names)} publish on {topic} and may {what}; "
                    f"let them publish on {topics.cmd_vel_ac}"
                )
        if wrong:
            raise RobotUnavailable(f"robot {self.id} at {node.get_namespace()}: {'; '.join(wrong)}")

    def _refusal(self) -> str:
        gate = self._gate
        if gate is not None and gate.session not in {"", self._order.session} and gate.alive:
            return "its mux follows somebody else, whose lease lives; end the other program that commands it"
        if gate is not None and gate.session == self._order.session:
            return "it does not come to rest although nothing is asked of it; who else moves it?"
        return f"its mux takes no order; does it hear {self._config.topics.order}, and use_sim_time as the robot does?"

"""The base of one simulated robot on keys: clock, odometry and battery out, velocity in."""

from __future__ import annotations

from math import cos, sin
from typing import Final

import zenoh

from soter.adapters.zenoh import messages
from soter.adapters.zenoh.options import CLOCK
from soter.adapters.zenoh.talk import Voice, announce, hear_velocity, stamp_of
from soter_sim.velocity_controlled import VelocityControlledBase
from soter_sim.world import World


class Base(VelocityControlledBase):
    """One robot.

    Args:
        session: the Zenoh session to use.
        namespace: the prefix of its keys.
        world: the robot's world.
        robot_id: its number.
        stamped: whether velocities come as TwistStamped.
    """

    def __init__(
        self,
        session: zenoh.Session,
        namespace: str,
        world: World,
        robot_id: int,
        *,
        stamped: bool,
    ) -> None:
        super().__init__(world, robot_id)
        self._namespace: Final = namespace
        self._clock: Final = Voice(session, f"{namespace}/{CLOCK}")
        self._odometry: Final = Voice(session, f"{namespace}/odom")
        self._battery: Final = Voice(session, f"{namespace}/battery_state")
        self.ear: Final = hear_velocity(session, f"{namespace}/cmd_vel", self.drive, stamped=stamped)
        self._token: Final = announce(session, namespace, "base")

    def tell_clock(self) -> None:
        self._clock.say(messages.RosClock(stamp_of(self.clock_s)))

    def tell_odometry(self) -> None:
        bodies, i = self._world.bodies, self._index
        half = 0.5 * bodies.heading[i]
        self._odometry.say(
            messages.Odometry(
                messages.Header(stamp_of(self.clock_s), f"{self._namespace}/odom"),
                f"{self._namespace}/base_link",
                messages.PoseWithCovariance(
                    messages.Pose(
                        messages.Point(bodies.x[i], bodies.y[i]), messages.Quaternion(z=sin(half), w=cos(half))
                    )
                ),
                messages.TwistWithCovariance(
                    messages.Twist(messages.Vector3(x=bodies.v[i]), messages.Vector3(z=bodies.yaw_rate[i]))
                ),
            )
        )

    def tell_battery(self) -> None:
        header = messages.Header(stamp_of(self.clock_s), f"{self._namespace}/base_link")
        charge = self._world.bodies.charge[self._index]
        self._battery.say(messages.BatteryState(header, percentage=charge, present=True))

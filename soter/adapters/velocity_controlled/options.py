"""Options of robots behind a mux in mission files, for any middleware."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from soter.adapters.velocity_controlled.robot import BASE, VelocityControlledRobot
from soter.config.promises import Promise
from soter.onboard.drive import tube_m
from soter.onboard.wire import CMD_VEL, CMD_VEL_AC, CMD_VEL_SC, GATE, ORDER
from soter.sdk import BackendConfig, Capabilities, RobotSpec

Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Named(BaseModel):
    """Options with names that follow the middleware's rules."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    check: ClassVar[Callable[..., None]]
    """Checks a name; raises a ValueError that says what is allowed."""


class MessageNames(_Named):
    """The names of a robot's messages.

    Attributes:
        odom: nav_msgs/Odometry.
        battery: sensor_msgs/BatteryState; empty for a robot that does not report its battery.
        cmd_vel: the mux's output; only watched, for programs that drive the robot past the mux.
        cmd_vel_ac: the AC's velocities.
        cmd_vel_sc: the SC's velocities.
        order: the mux's orders: active controller and lease.
        gate: the mux's reports.
    """

    odom: str = "odom"
    battery: str = "battery_state"
    cmd_vel: str = CMD_VEL
    cmd_vel_ac: str = CMD_VEL_AC
    cmd_vel_sc: str = CMD_VEL_SC
    order: str = ORDER
    gate: str = GATE

    @field_validator("*")
    @classmethod
    def _is_a_name(cls, name: str, field: ValidationInfo) -> str:
        if name or field.field_name != "battery":
            cls.check(name)
        return name


class PlaceOptions(_Named):
    """The place of one robot.

    Attributes:
        namespace: the namespace of its messages.
        odom_origin: the pose in the workspace, east and north in metres and radians counter-clockwise from east, at
            which its odometry reads 0, 0, 0.
    """

    namespace: str
    odom_origin: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)

    @field_validator("namespace")
    @classmethod
    def _is_a_name(cls, namespace: str) -> str:
        cls.check(namespace)
        return namespace


class VelocityControlledConfig(BackendConfig):
    """Options that all backends with velocity-controlled robots have.

    Attributes:
        stamped: whether velocities are TwistStamped instead of Twist.
        discovery_s: longest time to wait for a robot's first messages.
        truth: `host:port` of the ground truth of a simulated world that was started by hand.
    """

    stamped: bool = False
    discovery_s: Annotated[float, Field(gt=0.0, le=600.0)] = 10.0
    truth: str | None = None

    def promised(self) -> Capabilities:
        """Return the robots' promise; for robots faster than a TurtleBot tube and noise grow, unless they are given."""
        return promised(self.promise)


def promised(promise: Promise) -> Capabilities:
    """Return the full promise of robots for which some figures are given."""
    declared, given = VelocityControlledRobot.declared, promise.given
    base = replace(declared, **given)
    limits = replace(BASE, v_max_m_s=base.v_max_m_s, brake_m_s2=base.brake_m_s2)
    # While clocks are being learned, stamps are off, and so positions at top speed.
    noise_m = declared.position_noise_m * max(1.0, base.v_max_m_s / declared.v_max_m_s)
    derived = {"tube_m": tube_m(limits, base.latency_s + base.setpoint_period_s), "position_noise_m": noise_m}
    return replace(base, **{**derived, **given})


def promising(spec: RobotSpec, config: VelocityControlledConfig) -> RobotSpec:
    """Return a robot with the promise of the backend's options, unless it has a promise of its own."""
    return spec if spec.promised is not None else replace(spec, promised=config.promised())

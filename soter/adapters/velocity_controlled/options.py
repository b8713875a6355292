"""What mission files say of robots behind a mux, whatever carries the messages."""

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
    """Has names of the carrier's."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    check: ClassVar[Callable[..., None]]
    """Refuses what is no name with a ValueError that says what is allowed."""


class MessageNames(_Named):
    """Where the messages of a robot are.

    Attributes:
        odom: nav_msgs/Odometry.
        battery: sensor_msgs/BatteryState; empty for a robot that says nothing of its battery.
        cmd_vel: what the mux passes on; looked at only, to see what drives the robot past the mux.
        cmd_vel_ac: what the AC asks for.
        cmd_vel_sc: what the SC asks for.
        order: who is in charge, to the mux.
        gate: what the mux does.
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
    """Where one robot is.

    Attributes:
        namespace: of its messages.
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
    """Options that every backend has whose robots are streamed to.

    Attributes:
        stamped: velocities are TwistStamped instead of Twist.
        discovery_s: how long to wait for what a robot says, at most.
        truth: `host:port` at which a simulated world that was started by hand says what really happens.
    """

    stamped: bool = False
    discovery_s: Annotated[float, Field(gt=0.0, le=600.0)] = 10.0
    truth: str | None = None

    def promised(self) -> Capabilities:
        """Return what robots promise: those that are faster than a TurtleBot stray as much more, unless it is given."""
        return promised(self.promise)


def promised(promise: Promise) -> Capabilities:
    """Return what robots promise where so much is given."""
    declared, given = VelocityControlledRobot.declared, promise.given
    base = replace(declared, **given)
    limits = replace(BASE, v_max_m_s=base.v_max_m_s, brake_m_s2=base.brake_m_s2)
    # While clocks are learned, a position is off by so much time at top speed.
    noise_m = declared.position_noise_m * max(1.0, base.v_max_m_s / declared.v_max_m_s)
    derived = {"tube_m": tube_m(limits, base.latency_s + base.setpoint_period_s), "position_noise_m": noise_m}
    return replace(base, **{**derived, **given})


def promising(spec: RobotSpec, config: VelocityControlledConfig) -> RobotSpec:
    """Return a robot with what it is asked to promise: for all of them, unless something is asked of it already."""
    return spec if spec.promised is not None else replace(spec, promised=config.promised())

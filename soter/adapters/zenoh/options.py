"""Options of the backend `zenoh`, given in `[backends.zenoh]` of a mission file."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from soter.adapters.zenoh.session import SessionOptions
from soter.mux.station import PERIOD_S
from soter.mux.wire import CMD_VEL, CMD_VEL_AC, CMD_VEL_SC, GATE, ORDER
from soter.problems import not_allowed
from soter.sdk import BackendConfig, Capabilities
from soter.streamed.robot import StreamedRobot

_KEY: Final = re.compile(r"[^/*$?#\s]+(/[^/*$?#\s]+)*")

CLOCK: Final = "clock"
"""The key of a simulated world's clock, which is /clock in ROS."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


def checked_key(key: str) -> str:
    """Return a key that names one thing.

    Raises:
        ValueError: it begins or ends with a slash, or is a pattern.
    """
    if not _KEY.fullmatch(key):
        raise not_allowed("a key such as robot1/odom, without a slash at either end and without * $ ? #")
    return key


class Keys(BaseModel):
    """Where the messages of a robot are: below its namespace, or with a leading slash, which is no part of the key.

    These are the names of the ROS topics, as zenoh-bridge-ros2dds has them.

    Attributes:
        odom: nav_msgs/Odometry.
        battery: sensor_msgs/BatteryState; empty for a robot that says nothing of its battery.
        cmd_vel: what the mux passes on; looked at only, for whoever drives the robot past the mux.
        cmd_vel_ac: what the AC asks for.
        cmd_vel_sc: what the SC asks for.
        order: who is in charge, to the mux.
        gate: what the mux does.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    odom: str = "odom"
    battery: str = "battery_state"
    cmd_vel: str = CMD_VEL
    cmd_vel_ac: str = CMD_VEL_AC
    cmd_vel_sc: str = CMD_VEL_SC
    order: str = ORDER
    gate: str = GATE

    @field_validator("*")
    @classmethod
    def _is_a_key(cls, key: str, field: ValidationInfo) -> str:
        if field.field_name != "battery" or key:
            checked_key(key.removeprefix("/"))
        return key

    def of(self, namespace: str) -> Keys:
        """Return the keys of one robot, in full."""
        given = self.model_dump().items()
        full = {name: key[1:] if key.startswith("/") else key and f"{namespace}/{key}" for name, key in given}
        return Keys.model_validate(full)


class RobotOptions(BaseModel):
    """Where one robot is.

    Attributes:
        namespace: what its keys begin with, such as robot1.
        odom_origin: the pose in the workspace, east and north in metres and radians counter-clockwise from east, at
            which its odometry reads 0, 0, 0.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    namespace: str
    odom_origin: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)

    @field_validator("namespace")
    @classmethod
    def _is_a_key(cls, namespace: str) -> str:
        return checked_key(namespace)


class ZenohConfig(BackendConfig):
    """Options of the backend `zenoh`.

    Attributes:
        robots: by number, where the robots are; where none is given, simulated ones are started.
        keys: what their keys are called.
        stamped: velocities are TwistStamped instead of Twist.
        session: how Zenoh is reached.
        discovery_s: how long to wait for what a robot says, at most.
        speedup: seconds of the robots in one second of the host; for simulated ones only.
        truth: `host:port` at which a simulated world that was started by hand says what really happens.
    """

    robots: dict[int, RobotOptions] = Field(default_factory=dict)
    keys: Keys = Keys()
    stamped: bool = False
    session: SessionOptions = SessionOptions()
    discovery_s: Annotated[float, Field(gt=0.0, le=600.0)] = 10.0
    speedup: Positive = 1.0
    truth: str | None = None

    @field_validator("session")
    @classmethod
    def _leads_to_robots(cls, session: SessionOptions, info: ValidationInfo) -> SessionOptions:
        if session.connect and not info.data.get("robots", True):
            raise not_allowed("connect only with robots to reach, a table [backends.zenoh.robots.N] for each")
        return session

    def promised(self) -> Capabilities:
        """Return what the robots promise: times are in fleet time, of which a host second has `speedup`."""
        declared, speedup = StreamedRobot.declared, self.speedup
        return replace(
            declared,
            latency_s=declared.latency_s * speedup,
            sample_age_s=declared.sample_age_s * speedup,
            jitter_s=declared.jitter_s * speedup,
            lease_s=declared.lease_s + PERIOD_S * (speedup - 1.0),
            position_noise_m=declared.position_noise_m * speedup,
        )

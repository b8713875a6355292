"""Options of the backend `ros2`, given in `[backends.ros2]` of a mission file."""

from __future__ import annotations

import re
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from soter.mux.wire import CMD_VEL, CMD_VEL_AC, CMD_VEL_SC, GATE, ORDER
from soter.sdk import BackendConfig

_NAME: Final = re.compile(r"[~/]?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")

Finite = Annotated[float, Field(allow_inf_nan=False)]


def _checked_name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError("allowed: a ROS name, such as odom or /robot1/odom")
    return name


class Topics(BaseModel):
    """Where the topics of a robot are; a name without a leading slash is relative to the robot's namespace.

    Attributes:
        odom: nav_msgs/Odometry.
        battery: sensor_msgs/BatteryState; empty for a robot that says nothing of its battery.
        cmd_vel: what the mux publishes; looked at only, for whoever publishes there past the mux.
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
    def _is_a_name(cls, name: str, field: ValidationInfo) -> str:
        return name if field.field_name == "battery" and not name else _checked_name(name)


class RobotOptions(BaseModel):
    """Where one robot is.

    Attributes:
        namespace: of its topics, such as /robot1.
        odom_origin: the pose in the workspace, east and north in metres and radians counter-clockwise from east, at
            which its odometry reads 0, 0, 0.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    namespace: str
    odom_origin: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)

    @field_validator("namespace")
    @classmethod
    def _is_a_name(cls, name: str) -> str:
        return _checked_name(name)


class Ros2Config(BackendConfig):
    """Options of the backend `ros2`.

    Attributes:
        robots: by number, where the robots are; where none is given, simulated ones are started.
        topics: what their topics are called.
        stamped: velocities are TwistStamped instead of Twist.
        use_sim_time: ROS time is that of `/clock`; needed with simulated robots, which have it in any case.
        domain_id: the ROS domain; the default is that of the environment variable ROS_DOMAIN_ID.
        discovery_s: how long to wait for a robot's topics, at most.
        truth: `host:port` at which a simulated world that was started by hand says what really happens.
        loopback: keep DDS on this host, as simulated robots do that are started by hand with `soter sim ros2`.
    """

    robots: dict[int, RobotOptions] = Field(default_factory=dict)
    topics: Topics = Topics()
    stamped: bool = False
    use_sim_time: bool = False
    domain_id: Annotated[int, Field(ge=0, le=232)] | None = None
    discovery_s: Annotated[float, Field(gt=0.0, le=600.0)] = 10.0
    truth: str | None = None
    loopback: bool = False

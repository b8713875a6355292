"""Options of the backend `ros2`, given in `[backends.ros2]` of a mission file."""

from __future__ import annotations

import re
from typing import Annotated, Final

from pydantic import Field

from soter.sdk import BackendConfig
from soter.streamed.options import MessageNames, PlaceOptions

_NAME: Final = re.compile(r"[~/]?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


class Topics(MessageNames):
    """Where the topics of a robot are; a name without a leading slash is relative to the robot's namespace."""

    @classmethod
    def check(cls, name: str) -> None:
        _check_name(name)


class RobotOptions(PlaceOptions):
    """Where one robot is; its namespace is one of ROS, such as /robot1."""

    @classmethod
    def check(cls, namespace: str) -> None:
        _check_name(namespace)


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name):
        raise ValueError("allowed: a ROS name, such as odom or /robot1/odom")


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

"""Options of the backend `ros2`, given in `[backends.ros2]` of a mission file."""

from __future__ import annotations

import re
from typing import Annotated, Final

from pydantic import Field

from soter.adapters.velocity_controlled.options import MessageNames, PlaceOptions, VelocityControlledConfig
from soter.problems import not_allowed

_NAME: Final = re.compile(r"[~/]?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name):
        raise not_allowed("a ROS name such as odom or /robot1/odom")


class Topics(MessageNames):
    """The names of a robot's topics; a name without a leading slash is relative to the robot's namespace."""

    check = staticmethod(_check_name)


class Ros2RobotOptions(PlaceOptions):
    """The place of one robot; its namespace is a ROS namespace, such as /robot1."""

    check = staticmethod(_check_name)


class Ros2Config(VelocityControlledConfig):
    """Options of the backend `ros2`, besides those of `VelocityControlledConfig`.

    Attributes:
        robots: by number, the places of the robots; if empty, simulated robots are started.
        topics: the names of their topics.
        use_sim_time: whether ROS time is that of `/clock`, as it always is for simulated robots.
        domain_id: the ROS domain; the default is that of the environment variable ROS_DOMAIN_ID.
        loopback: whether to keep DDS on this host, as is needed for robots started with `soter sim ros2`.
    """

    robots: dict[int, Ros2RobotOptions] = Field(default_factory=dict)
    topics: Topics = Topics()
    use_sim_time: bool = False
    domain_id: Annotated[int, Field(ge=0, le=232)] | None = None
    loopback: bool = False

from __future__ import annotations

import os

import pytest

from soter.adapters.ros2.options import Ros2Config
from soter.adapters.ros2.simulator import SETTINGS, environment, loopback
from soter.config import validate_options
from soter.errors import ConfigError
from soter.geometry.workspace import Box, RobotPlace, Workspace

ROOM = Workspace(4.0, 4.0, (), (RobotPlace(1, 1.0, 1.0, Box(0.9, 0.9, 1.1, 1.1)),))


def config(**options: object) -> Ros2Config:
    return validate_options(Ros2Config, options, None, "backends.ros2", {"workspace": ROOM})


def test_topics_can_be_called_otherwise() -> None:
    given = config(topics={"odom": "/vicon/odom", "battery": ""}, robots={"1": {"namespace": "/tb1"}})
    assert given.topics.odom == "/vicon/odom"
    assert given.topics.cmd_vel_sc == "cmd_vel_sc"
    assert given.robots[1].odom_origin == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (
            {"topics": {"odom": "my odom"}},
            "backends.ros2.topics.odom: it is 'my odom', allowed: a ROS name such as odom or /robot1/odom",
        ),
        ({"topics": {"odom": ""}}, "backends.ros2.topics.odom: it is '', allowed: a ROS name"),
        ({"topics": {"odometry": "odom"}}, "topics.odometry: unknown key"),
        ({"robots": {"1": {"namespace": "1st"}}}, "robots.1.namespace: it is '1st', allowed: a ROS name"),
        ({"robots": {"1": {}}}, "robots.1.namespace"),
        ({"robots": {"1": {"namespace": "/a", "odom_origin": [0.0, float("nan"), 0.0]}}}, "odom_origin"),
        ({"domain_id": 233}, "domain_id: it is 233, allowed: at most 232"),
        ({"discovery_s": 0}, "discovery_s: it is 0, allowed: above 0"),
        ({"qos": "best effort"}, "backends.ros2.qos: unknown key"),
    ],
)
def test_bad_options_are_named(options: dict[str, object], complaint: str) -> None:
    with pytest.raises(ConfigError) as caught:
        config(**options)
    assert complaint in str(caught.value)


def test_the_environment_is_as_before_after_it_was_kept_on_this_host(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "another")
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    before = dict(os.environ)
    with loopback():
        assert {name: os.environ[name] for name in SETTINGS} == dict(SETTINGS)
        assert "ROS_LOCALHOST_ONLY" not in os.environ
    assert dict(os.environ) == before
    assert "ROS_LOCALHOST_ONLY" not in environment()
    assert environment()["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"

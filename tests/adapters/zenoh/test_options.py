from __future__ import annotations

import pytest

from soter.adapters.zenoh.options import Keys, ZenohConfig
from soter.config import validate_options
from soter.errors import ConfigError
from soter.geometry.workspace import Box, RobotPlace, Workspace

ROOM = Workspace(4.0, 4.0, (), (RobotPlace(1, 1.0, 1.0, Box(0.9, 0.9, 1.1, 1.1)),))


def config(**options: object) -> ZenohConfig:
    return validate_options(ZenohConfig, options, None, "backends.zenoh", {"workspace": ROOM})


def test_keys_can_be_called_otherwise() -> None:
    given = config(keys={"odom": "/vicon/odom", "battery": ""}, robots={"1": {"namespace": "hall/tb1"}})
    keys = given.keys.of(given.robots[1].namespace)
    assert keys.odom == "vicon/odom"
    assert keys.battery == ""
    assert keys.cmd_vel_sc == "hall/tb1/cmd_vel_sc"
    assert keys.order == "hall/tb1/soter/order"
    assert given.robots[1].odom_origin == (0.0, 0.0, 0.0)


def test_keys_are_the_topics_of_ros() -> None:
    assert Keys().of("robot1").model_dump() == {
        "odom": "robot1/odom",
        "battery": "robot1/battery_state",
        "cmd_vel": "robot1/cmd_vel",
        "cmd_vel_ac": "robot1/cmd_vel_ac",
        "cmd_vel_sc": "robot1/cmd_vel_sc",
        "order": "robot1/soter/order",
        "gate": "robot1/soter/gate",
    }


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (
            {"keys": {"odom": "my odom"}},
            "backends.zenoh.keys.odom: it is 'my odom', allowed: a key such as robot1/odom",
        ),
        ({"keys": {"odom": ""}}, "backends.zenoh.keys.odom: it is '', allowed: a key"),
        ({"keys": {"odom": "*/odom"}}, "keys.odom: it is '*/odom', allowed: a key"),
        ({"keys": {"odom": "//odom"}}, "keys.odom: it is '//odom', allowed: a key"),
        ({"keys": {"odometry": "odom"}}, "keys.odometry: unknown key"),
        ({"robots": {"1": {"namespace": "/robot1"}}}, "robots.1.namespace: it is '/robot1', allowed: a key"),
        ({"robots": {"1": {}}}, "robots.1.namespace"),
        ({"robots": {"1": {"namespace": "a", "odom_origin": [0.0, float("nan"), 0.0]}}}, "odom_origin"),
        ({"discovery_s": 0}, "discovery_s: it is 0, allowed: above 0"),
        ({"speedup": 0.0}, "speedup: it is 0.0, allowed: above 0"),
        ({"session": {"connect": ["tcp/127.0.0.1:7447"]}}, "connect only with robots to reach"),
        ({"session": {"mode": "clinet"}}, "did you mean 'client'?"),
        ({"qos": "best effort"}, "backends.zenoh.qos: unknown key"),
    ],
)
def test_bad_options_are_named(options: dict[str, object], complaint: str) -> None:
    with pytest.raises(ConfigError) as caught:
        config(**options)
    assert complaint in str(caught.value)


def test_robots_to_reach_may_be_anywhere() -> None:
    given = config(session={"connect": ["tcp/127.0.0.1:7447"]}, robots={"1": {"namespace": "robot1"}})
    assert given.session.connect == ("tcp/127.0.0.1:7447",)


def test_at_a_speedup_all_times_of_the_host_are_longer() -> None:
    one, two = config().promised(), config(speedup=2.0).promised()
    assert two.latency_s == 2.0 * one.latency_s
    assert two.sample_age_s == 2.0 * one.sample_age_s
    assert two.jitter_s == 2.0 * one.jitter_s
    assert two.lease_s > one.lease_s
    assert two.v_max_m_s == one.v_max_m_s

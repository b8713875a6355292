"""The adapter over real DDS, on loopback, against simulated robots in processes of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

import pytest

from soter.errors import RobotUnavailable, Unsupported
from soter.sdk import Controller, GoalStatus, Link, Waypoint
from tests.adapters.velocity_controlled import behaviour
from tests.adapters.velocity_controlled.driving import PATIENT, ROOM, SPECS, tick
from tests.waiting import wait_until

if TYPE_CHECKING:
    from soter.adapters.ros2.graph import Graph
    from soter.adapters.ros2.simulator import Ros2Simulator
    from soter.sdk.wire import WireFleet

pytestmark = pytest.mark.rclpy

Open = Callable[..., "WireFleet[Any]"]


def test_with_no_robot_given_it_starts_its_own_and_ends_them() -> None:
    from soter.adapters.ros2.backend import Ros2Backend
    from soter.adapters.ros2.options import Ros2Config

    with Ros2Backend().open(Ros2Config(workspace=ROOM), SPECS) as fleet:
        behaviour.drives(fleet)
        simulator = fleet.simulator
        assert simulator is not None
    assert simulator.world.returncode == 0
    assert [process.returncode for process in simulator.muxes.values()] == [0, 0]


def test_it_gets_along_with_code_that_uses_rclpy_itself(simulator: Ros2Simulator, open_fleet: Open) -> None:
    import rclpy

    from soter.adapters.ros2.simulator import loopback

    with loopback():
        rclpy.init(domain_id=simulator.domain_id)
        node = rclpy.create_node("mine")
    try:
        with open_fleet(simulator) as fleet:
            assert fleet.robots[0].read_state().link is Link.UP
        assert rclpy.ok()
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_stamped_velocities(open_fleet: Open) -> None:
    from soter.adapters.ros2.simulator import Ros2Simulator

    simulator = Ros2Simulator(ROOM.with_robots(1), SPECS[:1], stamped=True)
    try:
        with open_fleet(simulator, stamped=True) as fleet:
            goal = fleet.robots[0].goto(Waypoint(2.3, 2.6), Controller.SC)
            assert tick(fleet, lambda: not goal.active, 10.0)
            assert goal.status is GoalStatus.REACHED
    finally:
        simulator.close()


def test_two_simulators_never_share_a_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    from soter.adapters.ros2 import simulator as simulators

    # Domains that are not drawn from otherwise.
    monkeypatch.setattr(simulators, "_DOMAINS", range(111, 114))
    domains = [simulators.Domain() for _ in range(3)]
    assert {each.id for each in domains} == {111, 112, 113}
    with pytest.raises(RobotUnavailable, match="every ROS domain from 111 to 113 is in use on this host"):
        simulators.Domain()
    for each in domains:
        each.close()


# --- what is refused, and how it is said -------------------------------------------------------------------


def refusal(fleet: WireFleet[Any], *, seeing: Sequence[str] = ()) -> str:
    """What its first robot is refused with, once it has discovered who publishes on some topics."""
    from soter.adapters.ros2.graph import publishers

    wait_until(lambda: all(publishers(fleet.robots[0].node, topic, nameless=False) for topic in seeing))
    with pytest.raises(RobotUnavailable) as caught:
        fleet.robots[0].init(20.0)
    return str(caught.value)


def test_what_is_missing_is_listed(simulator: Ros2Simulator, open_fleet: Open) -> None:
    fleet = open_fleet(simulator, ready=False, robots={1: {"namespace": "/nobody"}}, discovery_s=1.0)
    text = refusal(fleet, seeing=["/clock"])
    assert text.startswith("robot 1 at /nobody: within 1 s: ")
    for missing in ("no node publishes odom", "no node publishes battery_state", "no node publishes soter/gate",
                    "no node subscribes to cmd_vel_sc"):  # fmt: skip
        assert missing in text
    assert "/clock" not in text
    assert "Is the robot running, with `soter ros2-mux` beside it" in text


def test_a_publisher_that_does_not_match_is_named(simulator: Ros2Simulator, open_fleet: Open, graph: Graph) -> None:
    from std_msgs.msg import Float64, String

    from soter.adapters.ros2.graph import COMMAND

    node = graph.node("/elsewhere")
    node.create_publisher(String, "gate", COMMAND)
    node.create_publisher(Float64, "odom", COMMAND)
    topics = {"odom": "/elsewhere/odom", "gate": "/elsewhere/gate"}
    fleet = open_fleet(simulator, ready=False, topics=topics, discovery_s=1.0)
    text = refusal(fleet, seeing=list(topics.values()))
    assert "/elsewhere/soter publishes /elsewhere/odom as std_msgs/msg/Float64, SOTER as nav_msgs/msg/Odometry" in text
    assert "/elsewhere/soter publishes /elsewhere/gate with a quality of service that does not match: " in text
    assert "transient local" in text.lower()


def test_velocities_of_the_other_type_are_named(simulator: Ros2Simulator, open_fleet: Open) -> None:
    text = refusal(open_fleet(simulator, ready=False, stamped=True), seeing=["/robot1/soter/gate"])
    assert "/robot1/soter_mux subscribes to cmd_vel_sc as geometry_msgs/msg/Twist" in text
    assert "SOTER as geometry_msgs/msg/TwistStamped" in text


@pytest.mark.parametrize(
    ("topic", "what"), [("cmd_vel", "drive it past the mux"), ("cmd_vel_sc", "speak for its safe controller")]
)
def test_whoever_can_go_round_the_mux_is_named(
    simulator: Ros2Simulator, open_fleet: Open, graph: Graph, topic: str, what: str
) -> None:
    from geometry_msgs.msg import Twist

    graph.node("/teleop").create_publisher(Twist, f"/robot1/{topic}", 1)
    text = refusal(open_fleet(simulator, ready=False))
    assert f"/teleop/soter publish on {topic} and may {what}; let them publish on cmd_vel_ac" in text


@pytest.mark.parametrize("topic", ["cmd_vel", "cmd_vel_sc"])
def test_whoever_goes_round_the_mux_later_is_noticed_too(
    simulator: Ros2Simulator, open_fleet: Open, graph: Graph, topic: str
) -> None:
    from geometry_msgs.msg import Twist

    robot = open_fleet(simulator).robots[0]

    assert not behaviour.intruder(robot)
    node = graph.node("/teleop")
    publisher = node.create_publisher(Twist, f"/robot1/{topic}", 1)
    wait_until(lambda: "/teleop/soter publish" in behaviour.intruder(robot))
    node.destroy_publisher(publisher)
    wait_until(lambda: not behaviour.intruder(robot))


def test_a_robot_that_follows_another_program_is_refused(open_fleet: Open) -> None:
    from soter.adapters.ros2.simulator import Ros2Simulator

    with (
        closing(Ros2Simulator(ROOM.with_robots(1), PATIENT)) as simulator,
        open_fleet(simulator, specs=PATIENT) as first,
        open_fleet(simulator, specs=PATIENT, ready=False) as other,
    ):
        behaviour.follows_another_program(first, other)


def test_an_ac_that_is_somebody_elses_is_not_spoken_for(
    simulator: Ros2Simulator, open_fleet: Open, graph: Graph
) -> None:
    from soter.adapters.ros2 import graph as graphs

    fleet = open_fleet(simulator, external_ac=True)
    robot = fleet.robots[0]
    assert graphs.publishers(graph.node("/looking"), "/robot1/cmd_vel_ac") == []
    robot.switch_ac_sc(Controller.AC, "test")
    with pytest.raises(Unsupported, match="its AC is another program"):
        robot.goto(Waypoint(2.3, 2.6), Controller.AC)


# --- what stops what ---------------------------------------------------------------------------------------


def test_when_soter_falls_silent_the_robot_stops(simulator: Ros2Simulator, open_fleet: Open) -> None:
    behaviour.silence(open_fleet(simulator))


def test_when_its_mux_dies_the_robot_stops_and_goes_on_with_the_next(
    simulator: Ros2Simulator, open_fleet: Open
) -> None:
    behaviour.mux_dies(open_fleet(simulator), simulator)


def test_when_the_robot_dies_its_link_goes_down_and_closing_does_not_hang(
    simulator: Ros2Simulator, open_fleet: Open
) -> None:
    behaviour.robot_dies(open_fleet(simulator), simulator)


def test_a_robot_that_was_switched_off_and_on_again_works_without_a_restart(
    simulator: Ros2Simulator, open_fleet: Open
) -> None:
    from soter.adapters.ros2.simulator import Ros2Simulator as Another

    def start_again() -> Another:
        return Another(ROOM.with_robots(1), SPECS[:1], domain_id=simulator.domain_id)

    behaviour.robot_reboots(open_fleet(simulator, truth=None), simulator, start_again, on_s=20.0)

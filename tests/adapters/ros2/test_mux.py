"""The mux as a program: what it needs, how it ends, what it says of bad parameters."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from soter.adapters.velocity_controlled.robot import wait_for

if TYPE_CHECKING:
    from soter.adapters.ros2.graph import Graph
    from soter.adapters.ros2.simulator import Ros2Simulator

pytestmark = pytest.mark.rclpy

ITS_OWN = {
    "soter",
    "soter.adapters",
    "soter.adapters.ros2",
    "soter.adapters.ros2.executor",
    "soter.adapters.ros2.mux",
    "soter.controller",
    "soter.lazy",
    "soter.onboard",
    "soter.onboard.gate",
    "soter.onboard.mux",
    "soter.onboard.program",
    "soter.onboard.gate_node",
    "soter.onboard.velocity",
    "soter.onboard.wire",
}


def modules_after(imports: str) -> set[str]:
    program = f"import sys\n{imports}\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_it_needs_nothing_but_ros_and_a_few_modules_of_the_standard_library_only() -> None:
    ros = "import rclpy, rclpy.exceptions, rclpy.executors, rclpy.node, rclpy.signals, geometry_msgs.msg, std_msgs.msg"
    more = modules_after("import soter.adapters.ros2.mux") - modules_after(ros)
    assert {name for name in more if name.partition(".")[0] not in sys.stdlib_module_names} == ITS_OWN


@pytest.mark.parametrize(
    ("before", "kind"),
    [
        ("", "EventsExecutor"),
        ("sys.modules['rclpy.experimental'] = None", "SingleThreadedExecutor"),
        # As in a notebook.
        ("import io; sys.stderr = io.StringIO()", "SingleThreadedExecutor"),
    ],
)
def test_its_executor_is_the_cheap_one_if_there_is_one_and_leaves_the_fault_handler_alone(
    before: str, kind: str
) -> None:
    program = f"""
import faulthandler, sys
from rclpy.context import Context
from soter.adapters.ros2.executor import executor_in
{before}
context = Context()
context.init()
print(type(executor_in(context)).__name__, faulthandler.is_enabled())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=30)
    assert done.stdout.split() == [kind, "False"]


@pytest.mark.parametrize(
    ("parameter", "complaint"),
    [
        ("lease_s:=0.0", "parameter lease_s is 0.0, allowed: above 0"),
        ("v_max_m_s:=.nan", "parameter v_max_m_s is nan, allowed: above 0"),
        ("command_s:=soon", "parameter command_s is 'soon', allowed: above 0"),
        # A whole number is one too: here nothing but the next one is wrong.
        ("v_max_m_s:=1 -p yaw_rate_max_rad_s:=0", "parameter yaw_rate_max_rad_s is 0, allowed: above 0"),
    ],
)
def test_a_bad_parameter_ends_it_before_anything_moves(parameter: str, complaint: str) -> None:
    from soter.adapters.ros2.simulator import environment

    done = subprocess.run(
        [sys.executable, "-m", "soter.adapters.ros2.mux", "--robot", "r1", "--ros-args", "-p", *parameter.split()],
        capture_output=True, text=True, timeout=30, check=False, env=environment(),
    )  # fmt: skip
    assert done.returncode == 2
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr


def test_when_it_is_told_to_end_it_says_rest_last(simulator: Ros2Simulator, graph: Graph) -> None:
    from geometry_msgs.msg import Twist

    node = graph.node("/robot1")
    heard: list[float] = []
    node.create_subscription(Twist, "cmd_vel", lambda message: heard.append(message.linear.x), 10)
    assert wait_for(lambda: len(heard) > 5, 10.0)
    mux = simulator.muxes[1]
    mux.send_signal(signal.SIGTERM)
    assert mux.wait(5.0) == 0
    assert set(heard) == {0.0}


def test_one_that_its_middleware_does_not_let_go_is_ended_once_it_has_said_rest(
    simulator: Ros2Simulator, graph: Graph
) -> None:
    from geometry_msgs.msg import Twist

    from soter.adapters.ros2.simulator import environment

    heard: list[float] = []
    graph.node("/somebody").create_subscription(
        Twist, "/held/cmd_vel", lambda message: heard.append(message.linear.x), 10
    )
    program = (
        "from soter.adapters.ros2 import mux\n"
        "def stays(self):\n"
        "    while True: pass\n"
        "mux.MuxNode.destroy_node, mux.LEAVE_S = stays, 0.5\n"
        "mux.main(['--robot', '/held'])"
    )
    env = {**environment(), "ROS_DOMAIN_ID": str(simulator.domain_id)}
    with subprocess.Popen([sys.executable, "-c", program], env=env) as mux:
        try:
            assert wait_for(lambda: len(heard) > 5, 10.0)
            mux.send_signal(signal.SIGTERM)
            assert mux.wait(10.0) == -signal.SIGALRM
        finally:
            mux.kill()
    assert set(heard) == {0.0}


def test_what_is_beyond_the_limits_or_not_finite_does_not_reach_the_base(
    simulator: Ros2Simulator, graph: Graph
) -> None:
    from geometry_msgs.msg import Twist, Vector3
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import String

    from soter.adapters.ros2.graph import COMMAND, LATCHED, SENSOR
    from soter.onboard.wire import AC, Order

    node = graph.node("/somebody")
    passed: list[float] = []
    now_s = [0.0]

    def note_clock(message: Clock) -> None:
        now_s[0] = message.clock.sec + 1e-9 * message.clock.nanosec

    node.create_subscription(Clock, "/clock", note_clock, SENSOR)
    node.create_subscription(Twist, "/robot1/cmd_vel", lambda message: passed.append(message.linear.x), 10)
    orders = node.create_publisher(String, "/robot1/soter/order", LATCHED)
    asked = node.create_publisher(Twist, "/robot1/cmd_vel_ac", COMMAND)
    seq = 0

    def ask(speed_m_s: float, expected_m_s: float) -> bool:
        def passes() -> bool:
            nonlocal seq
            seq += 1
            orders.publish(String(data=Order("me", seq, AC, now_s[0]).encode()))
            asked.publish(Twist(linear=Vector3(x=speed_m_s)))
            return bool(passed) and passed[-1] == expected_m_s

        return wait_for(passes, 10.0)

    assert ask(5.0, 0.22)
    for nonsense in ('{"seq": 1' + "0" * 400 + "}", "[" * 2000, "[" * 100_000, '{"seq": 1e300}', ""):
        orders.publish(String(data=nonsense))
    assert ask(math.nan, 0.0)
    assert ask(-5.0, -0.22)
    assert ask(math.inf, 0.0)


def test_what_one_callback_cannot_take_deafens_no_other(graph: Graph, caplog: pytest.LogCaptureFixture) -> None:
    from std_msgs.msg import String

    node = graph.node("/somebody")
    heard: list[str] = []

    def take(message: String) -> None:
        heard.append(message.data)
        raise RuntimeError(message.data)

    node.create_subscription(String, "said", take, 10)
    said = node.create_publisher(String, "said", 10)

    def repeated() -> bool:
        said.publish(String(data="nonsense"))
        return len(heard) > 2

    assert wait_for(repeated, 10.0)
    assert node.failed >= 2
    assert caplog.text.count("dropped a message that could not be taken") == 1


def test_a_graphs_thread_is_gone_before_what_it_runs_is_shut_down(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    graph.node("/somebody")
    executor, running = graph._executor, list[bool]()

    def note() -> None:
        running.append(graph._thread.is_alive())
        executor.shutdown()

    names = ("spin_once", "create_task", "add_node")
    noted = SimpleNamespace(shutdown=note, **{name: getattr(executor, name) for name in names})
    monkeypatch.setattr(graph, "_executor", noted)
    graph.close()
    assert running == [False]

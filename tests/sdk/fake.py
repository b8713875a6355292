"""A robot that does what a test says, behind the real template."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from soter.clock import VirtualClock
from soter.sdk import Capabilities, Controller, Goal, Link, Robot, RobotSpec, RobotState

SPEC = RobotSpec(1, 0.0, 0.0, 0.0)

CAPABILITIES = Capabilities(
    in_process=True,
    deterministic=True,
    reverses=True,
    reports_battery=True,
    reports_controller=True,
    v_max_m_s=0.22,
    yaw_rate_max_rad_s=2.84,
    brake_m_s2=1.0,
    body_radius_m=0.105,
    latency_s=0.05,
    sample_age_s=0.0,
    jitter_s=0.0,
    setpoint_period_s=0.05,
    lease_s=0.1,
    tube_m=0.02,
    overshoot_m=0.01,
    position_noise_m=0.0,
    pivots_first=True,
)

STATE = RobotState(1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, Controller.SC, None, Link.UP)


class FakeRobot(Robot):
    """Notes every hook that is called; its sample is set by the test, with `place`.

    Attributes:
        calls: names of the hooks, in order.
        sent: the goals that went out.
        failing: hooks that raise, by name.
        found: what `_connect` reports.
    """

    declared: ClassVar[Capabilities] = CAPABILITIES

    def __init__(self, spec: RobotSpec = SPEC, clock: VirtualClock | None = None) -> None:
        self.time = clock or VirtualClock()
        super().__init__(spec, self.time)
        self.calls: list[str] = []
        self.sent: list[Goal] = []
        self.failing: set[str] = set()
        self.found = CAPABILITIES
        self.vehicle_in_charge = Controller.SC
        self.sample: RobotState | None = replace_state(STATE, robot_id=spec.id)

    def place(self, **values: Any) -> None:
        """Put out a new sample, stamped now unless told otherwise."""
        values = {"robot_id": self.id, "stamp_s": self.time.now(), "controller": self.vehicle_in_charge, **values}
        self.sample = replace_state(STATE, **values)

    def _called(self, hook: str) -> None:
        self.calls.append(hook)
        if hook in self.failing:
            raise OSError(f"{hook} failed")

    def _connect(self, timeout_s: float) -> Capabilities:
        self._called("connect")
        return self.found

    def _send_goto(self, goal: Goal) -> None:
        self._called("send")
        self.sent.append(goal)

    def _sample(self) -> RobotState | None:
        return self.sample

    def _hand_over(self, to: Controller) -> None:
        self._called(f"hand over {to}")
        self.vehicle_in_charge = to

    def _renew_lease(self) -> None:
        self._called("renew")

    def _halt(self) -> None:
        self._called("halt")

    def _disconnect(self, timeout_s: float) -> None:
        self._called("disconnect")


def replace_state(state: RobotState, **values: Any) -> RobotState:
    return state._replace(**values)


def ready_robot(in_charge: Controller = Controller.SC) -> FakeRobot:
    """Make a robot that is ready at time 0, with a controller in charge and nothing noted."""
    robot = FakeRobot()
    robot.init(1.0)
    robot.switch_ac_sc(in_charge, "test")
    robot.place()
    robot.read_state()
    robot.calls.clear()
    return robot


def capabilities(**values: Any) -> Capabilities:
    return replace(CAPABILITIES, **values)

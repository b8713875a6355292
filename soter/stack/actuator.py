"""The robot's narrow interface as the supervisor sees it, and the AC's forwarder."""

from __future__ import annotations

from numbers import Real
from typing import Any, Final

from soter.errors import Unsupported
from soter.rta import Node, Port, Request, Sample, Situation, Topic
from soter.sdk import Controller, Goal, GoalStatus, Robot, RobotState, Waypoint
from soter.stack.safe_controller import WAYPOINT

_ACTIVE: Final = GoalStatus.ACTIVE


class RobotActuator:
    """Drives one `Robot` for the supervisor, and tells the AC's port how its goals end. Supervisor's thread only."""

    def __init__(self, robot: Robot, port: Port[Waypoint, RobotState]) -> None:
        self.robot: Final = robot
        self.port: Final = port
        self._goal: Goal | None = None
        self._sent: Goal | None = None
        self._port_goal_id: int | None = None

    @property
    def goal(self) -> Goal | None:
        """The latest goal; None once it has ended."""
        return self._goal

    def read(self) -> RobotState:
        """Return the latest sample."""
        state = self.robot.read_state()
        port = self.port
        port.state = state
        if not port.engaged:
            port.refuse()
        goal = self._goal
        if goal is not None and goal.status is not _ACTIVE:
            self._ended(goal)
        return state

    def drive(self, command: Waypoint | Request[Waypoint] | None, mode: Controller) -> None:
        """Send a goal of the active controller; None stops the robot."""
        if command is None:
            # A reached goal has to be stopped too: within its radius the vehicle still drives on to the middle.
            if self._sent is not None:
                self._sent.cancel()
                self._sent = None
            if self._goal is not None:
                self._ended(self._goal)
            return
        if isinstance(command, Request):
            self._drive_for_ac(command)
        else:
            self._goal = self._sent = self.robot.goto(command, Controller.SC)
            self._port_goal_id = None

    def hand_over(self, mode: Controller, module: str, cause: str) -> None:
        """Switch the robot to another controller, and tell the AC's port."""
        self.robot.switch_ac_sc(mode, f"{module}: {cause}")
        self._sent = None
        if self._goal is not None:
            self._ended(self._goal)
        self.port.control(mode is Controller.AC, module, cause)

    def renew(self) -> None:
        """Renew the lease."""
        self.robot.renew_lease()

    def reported(self, sample: Sample) -> Controller | None:
        """Return the active controller that the robot reports."""
        return sample.controller if isinstance(sample, RobotState) else None

    def insist(self) -> None:
        """Resend which controller is active."""
        self.robot.hand_over_again()

    def _drive_for_ac(self, request: Request[Waypoint]) -> None:
        before = self._goal
        try:
            goal = self.robot.goto(_plain(request.command), Controller.AC)
        except (ValueError, TypeError, AttributeError, ArithmeticError, Unsupported):
            # The AC is untrusted: anything but a valid waypoint for this robot is refused, and the goal before goes on.
            self.port.report(request.goal_id, GoalStatus.REJECTED.value)
            return
        if before is not None:
            self._ended(before)
        self._goal = self._sent = goal
        self._port_goal_id = request.goal_id

    def _ended(self, goal: Goal) -> None:
        self._goal = None
        if self._port_goal_id is not None:
            self.port.report(self._port_goal_id, goal.status.value)
            self._port_goal_id = None


def _plain(command: Any) -> Any:
    """Return a waypoint of plain Python numbers; None if there are none to be made of the command.

    Numbers of other classes pass every check and may still fail later, in the vehicle.
    """
    if type(command) is not Waypoint:
        return command
    values: tuple[Any, ...] = command
    if all(type(value) is float or value is None for value in values):
        return command
    try:
        return Waypoint(*(float(value) if isinstance(value, Real) else value for value in values))
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - they are the AC's own objects
        return None


class PortForwarder(Node):
    """The AC as a node: every step publishes the request in the port's mailbox, if there is one."""

    name = "ac-port"
    subscribes = ("port",)
    publishes = (WAYPOINT,)

    def __init__(
        self, port: Port[Waypoint, RobotState], waypoint: Topic[Waypoint | Request[Waypoint]], period_s: float
    ) -> None:
        self.period_s = period_s
        self.request: Request[Waypoint] | None = None
        self._port: Final = port
        self.waypoint: Final[Topic[Any]] = waypoint

    def engage(self, situation: Situation) -> None:
        self.request = None

    def step(self, situation: Situation) -> None:
        request = self._port.take()
        if request is not None:
            self.request = request
            self.waypoint.publish(request)

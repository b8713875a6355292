"""The base of adapters to robots that drive to goals by themselves, behind a gate of their own.

An adapter only encodes, decodes, publishes and receives messages.
"""

from __future__ import annotations

import logging
import secrets
import threading
from abc import abstractmethod
from collections.abc import Callable
from typing import Final

from soter.clock import VehicleClock
from soter.errors import RobotUnavailable, account_of, raised_at
from soter.onboard.command import Command, GoalMessage, Report
from soter.sdk.capabilities import Capabilities
from soter.sdk.goal import Goal
from soter.sdk.robot import Robot
from soter.sdk.values import Controller, Link, RobotSpec, RobotState

logger = logging.getLogger(__name__)

SETTLED: Final = 10
"""Number of reports after which the least delay seen is close to the least possible one, and stamps are steady."""

_REPEAT_S: Final = 0.05
_LOST_S: Final = 1.0


class CommandedRobot(Robot):
    """One robot on a wire that takes a `Command` and sends a `Report`.

    Every call sends the complete command under a new number, and never waits. `receive` takes reports, in any one
    thread, and writes one field; everything else belongs to the calling thread.
    """

    def __init__(self, spec: RobotSpec, clock: VehicleClock) -> None:
        super().__init__(spec, clock)
        # Two underscores: an adapter may call its own attributes whatever it likes.
        self.__clock: Final = clock
        self.__command = Command(secrets.token_hex(8), 0, Controller.SC.value, "", None, None)
        self.__latest: tuple[RobotState, Report] | None = None
        self.__report: Report | None = None
        self.__heard = 0
        self.__dropped = 0
        self.__undecoded = ""
        self.__ready = False
        self.__changed: Final = threading.Condition()

    # --- what an adapter fills -----------------------------------------------------------------------------

    @abstractmethod
    def _publish(self, message: bytes) -> None:
        """Send a command; never wait. Drop it if it cannot be sent: the next one is complete again."""

    def _encode(self, command: Command) -> bytes:
        """Return the robot's encoding of a command."""
        return command.encode()

    def _decode(self, message: bytes) -> Report:
        """Return the report in a message; raise ValueError, or anything else, to have an invalid message dropped."""
        return Report.decode(message)

    def _release(self) -> None:
        """Free what the adapter opened for this robot. Called once, when the robot is closed."""

    # --- what an adapter calls -----------------------------------------------------------------------------

    def receive(self, message: bytes) -> None:
        """Take a message of the robot, as soon as it arrives, in the thread that received it."""
        received_s = self.__clock.steady_s()
        try:
            report = self.__decoded(message)
            if report.robot != self.id:
                raise ValueError(f"it is of robot {report.robot}, at the address of robot {self.id}")
        except Exception as failure:  # noqa: BLE001 - a bug in `_decode` must not end the thread that hears all robots
            # Until a valid message comes, the robot's sample ages and its link goes down.
            self.__dropped += 1
            if self.__dropped == 1:
                words = account_of(failure) + raised_at(failure)
                logger.warning("robot %d: a message that makes no sense was dropped: %s", self.id, words)
            return
        self.__hear(report, received_s)
        with self.__changed:
            self.__changed.notify_all()

    def __decoded(self, message: bytes) -> Report:
        """Return the report in a message; note why there is none."""
        try:
            return self._decode(message)
        except Exception as failure:
            self.__undecoded = account_of(failure) + raised_at(failure)
            raise

    def __hear(self, report: Report, received_s: float) -> None:
        before = self.__report
        anew = before is not None and report.clock != before.clock
        if anew:
            self.__heard = 0
        elif before is not None and report.stamp_s < before.stamp_s:
            # A newer report has overtaken it.
            return
        self.__clock.observe(self.id, report.stamp_s, received_s, anew=anew)
        self.__report = report
        self.__heard += 1
        if self.__heard < SETTLED:
            return
        # The controller and goal that it reports are ours only if it follows this program.
        ours = self.__is_ours(report, 0)
        state = RobotState(
            robot_id=self.id,
            stamp_s=self.__clock.to_fleet_s(self.id, report.stamp_s),
            vehicle_stamp_s=report.stamp_s,
            x_m=report.x_m,
            y_m=report.y_m,
            z_m=report.z_m,
            heading_rad=report.heading_rad,
            vx_m_s=report.vx_m_s,
            vy_m_s=report.vy_m_s,
            yaw_rate_rad_s=report.yaw_rate_rad_s,
            battery=report.battery,
            controller=Controller(report.gate.controller) if ours else None,
            goal_id=report.goal if ours else None,
            link=Link.UP,
            vz_m_s=report.vz_m_s,
        )
        self.__latest = (state, report)

    # --- the hooks of Robot --------------------------------------------------------------------------------

    def _connect(self, timeout_s: float) -> Capabilities:
        if not self.__settle(timeout_s):
            raise RobotUnavailable(f"robot {self.id}: {self.__refusal(timeout_s)}")
        self.__ready = True
        return self.declared

    def _send_goto(self, goal: Goal) -> None:
        to = goal.target
        self.__say(goal=GoalMessage(goal.id, goal.by.value, to.x_m, to.y_m, to.z_m, to.heading_rad, to.speed_m_s))

    def _sample(self) -> RobotState | None:
        latest = self.__latest
        return None if latest is None else latest[0]

    def _hand_over(self, to: Controller) -> None:
        # One message shuts the old controller's stream and drops its goal: the robot's gate flushes it at the change.
        same = to.value == self.__command.controller
        self.__say(controller=to.value, goal=self.__command.goal if same else None)

    def _renew_lease(self) -> None:
        report = self.__report
        assert report is not None
        # Stamped with the robot's own time, so that a message that arrives late renews nothing.
        self.__say(clock=report.clock, renewed_s=self.__clock.to_vehicle_s(self.id, self.clock.now()))

    def _halt(self) -> None:
        self.__say(goal=None)

    def _disconnect(self, timeout_s: float) -> None:
        try:
            if self.__ready:
                self.__command = self.__command._replace(controller=Controller.SC.value, goal=None, renewed_s=None)
                latest = self.__latest
                lost = latest is None or self.clock.now() - latest[0].stamp_s > self.stale_after_s
                # A robot that is no longer heard has been stopped by its lease: wait at most _LOST_S.
                self.__settle(min(timeout_s, _LOST_S) if lost else timeout_s)
        finally:
            self._release()

    def __say(self, **changes: object) -> None:
        """Send the complete command, with these changes, under a new number."""
        command = self.__command._replace(seq=self.__command.seq + 1, **changes)  # type: ignore[arg-type]
        self.__command = command
        self._publish(self._encode(command))

    def __settle(self, timeout_s: float) -> bool:
        """Repeat the command until the robot has taken it and stands still; return whether that happens in time."""
        first, until_s = self.__command.seq + 1, self.__clock.steady_s() + timeout_s
        while self.__clock.steady_s() < until_s:
            self.__say()
            if self.__wait(lambda: self.__follows_and_rests(first), _REPEAT_S):
                return True
        return False

    def __wait(self, holds: Callable[[], bool], timeout_s: float) -> bool:
        with self.__changed:
            return self.__changed.wait_for(holds, timeout_s)

    def __follows_and_rests(self, first: int) -> bool:
        """Return whether the robot has taken a command numbered `first` or higher, and stands still."""
        latest = self.__latest
        if latest is None:
            return False
        state, report = latest
        return self.__is_ours(report, first) and self.declared.rests(state)

    def __is_ours(self, report: Report, first: int) -> bool:
        """Return whether the robot follows this program, by a command numbered `first` or higher.

        Sessions are random. If an adapter puts a fixed name in their place, such as the robot's, two programs look
        alike; a number that was never sent here gives the other one away.
        """
        gate, own = report.gate, self.__command
        return gate.session == own.session and first <= gate.seq <= own.seq

    def __refusal(self, timeout_s: float) -> str:
        latest = self.__latest
        if latest is None and not self.__heard and self.__undecoded:
            return (
                f"{self.__dropped} messages came within {timeout_s:g} s, and none could be decoded; of the last one "
                f"`_decode` made {self.__undecoded}"
            )
        if latest is None:
            return (
                f"{self.__heard} reports were heard within {timeout_s:g} s; is its process running, and is its address "
                "right?"
            )
        state, gate = latest[0], latest[1].gate
        if gate.session == self.__command.session and gate.seq > self.__command.seq:
            return "another program commands it under the same session; `_encode` must pass on the session unchanged"
        if gate.session == self.__command.session:
            return self.declared.unrest(state)
        if gate.alive:
            return "it follows another program, whose lease lives; end that program"
        return "it reports, but takes no command; is its address for commands right?"

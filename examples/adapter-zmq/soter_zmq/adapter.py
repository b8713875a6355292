"""The backend `zmq`: robots that speak JSON over ZeroMQ, behind SOTER's narrow interface."""

from __future__ import annotations

import math
import secrets
from collections.abc import Sequence
from typing import ClassVar, Final

import zmq
from pydantic import BaseModel, ConfigDict, Field, field_validator

from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.sdk import (
    INTERFACE_VERSION,
    Backend,
    BackendConfig,
    Capabilities,
    Controller,
    Fleet,
    Goal,
    Link,
    Robot,
    RobotSpec,
    RobotState,
)
from soter.sdk.truth import ToldTruth
from soter_zmq.drive import OVERSHOOT_M, TUBE_M
from soter_zmq.receiver import Hear, Receiver
from soter_zmq.simulator import Simulator, describe
from soter_zmq.wire import (
    BODY_RADIUS_M,
    BRAKE_M_S2,
    LEASE_S,
    PERIOD_S,
    V_MAX_M_S,
    YAW_RATE_MAX_RAD_S,
    Command,
    GoalMessage,
    Report,
    compass_deg,
    heading_rad,
)

_SETTLED_REPORTS: Final = 10
"""After so many reports the least delay among them is near the least there is, and stamps no longer wander."""

_REPEAT_S: Final = 0.05
_LOST_S: Final = 1.0
_REST_M_S: Final = 1e-3
_REST_RAD_S: Final = 1e-2
_TRUTH_TIMEOUT_S: Final = 5.0


class Endpoints(BaseModel):
    """Where one robot is.

    Attributes:
        command: the address that takes commands.
        report: the address that reports come from.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    command: str
    report: str

    @field_validator("command", "report")
    @classmethod
    def _stays_here(cls, address: str) -> str:
        # Nothing on these sockets is encrypted or signed. A robot elsewhere is reached through a tunnel that is.
        if not address.startswith(("tcp://127.0.0.1:", "tcp://localhost:", "ipc://")):
            raise ValueError("allowed: tcp://127.0.0.1:PORT or ipc://PATH; reach other hosts through a tunnel")
        return address


class ZmqConfig(BackendConfig):
    """Options of the backend `zmq`.

    Attributes:
        robots: by number, where the robots are; where none is given, simulated ones are started.
        truth: where a simulator that was started by hand says what really happens.
    """

    robots: dict[int, Endpoints] = Field(default_factory=dict)
    truth: str | None = None


class ZmqRobot(Robot):
    """One robot on the wire.

    Commands are sent by whoever calls and never waited for: the socket takes each at once and keeps the last. Reports
    are heard by the receiver's thread, which writes one field, `_latest`; all else belongs to the calling thread.

    Args:
        spec: which robot.
        clock: follows the robots' clocks.
        commands: the socket to its commands.
    """

    declared: ClassVar[Capabilities] = Capabilities(
        in_process=False,
        deterministic=False,
        reverses=True,
        reports_battery=True,
        reports_controller=True,
        v_max_m_s=V_MAX_M_S,
        yaw_rate_max_rad_s=YAW_RATE_MAX_RAD_S,
        brake_m_s2=BRAKE_M_S2,
        body_radius_m=BODY_RADIUS_M,
        # Measured on a host with four times as much to do as it has cores: 0.036, 0.060 and 0.023 s at worst.
        latency_s=0.04,
        sample_age_s=0.07,
        jitter_s=0.03,
        setpoint_period_s=PERIOD_S,
        lease_s=LEASE_S,
        tube_m=TUBE_M,
        overshoot_m=OVERSHOOT_M,
        # Positions are exact. Stamps move by a millisecond or so while the clocks' offset is learned; at top speed that
        # is this far.
        position_noise_m=0.001,
        pivots_first=True,
    )

    def __init__(self, spec: RobotSpec, clock: VehicleClock, commands: zmq.Socket[bytes]) -> None:
        super().__init__(spec, clock)
        self.receiver: Receiver | None = None
        self._vehicle_clock: Final = clock
        self._commands: Final = commands
        self._command: Command = Command(secrets.token_hex(8), 0, None, Controller.SC.value, None)
        self._latest: tuple[RobotState, Report] | None = None
        self._heard = 0

    # --- the receiver's thread -----------------------------------------------------------------------------

    def hear(self, message: bytes, received_s: float) -> None:
        """Take a report, as `_sample` will return it."""
        report = Report.decode(message)
        if report.robot != self.id:
            raise ValueError(f"a report of robot {report.robot} came from the address of robot {self.id}")
        before = None if self._latest is None else self._latest[1]
        if before is not None and report.boot != before.boot:
            self._vehicle_clock.forget(self.id)
        elif before is not None and report.stamp_s < before.stamp_s:
            # It was overtaken on its way.
            return
        self._vehicle_clock.observe(self.id, report.stamp_s, received_s)
        ours = report.session == self._command.session
        state = RobotState(
            robot_id=self.id,
            stamp_s=self._vehicle_clock.to_fleet_s(self.id, report.stamp_s),
            vehicle_stamp_s=report.stamp_s,
            x_m=report.east_m,
            y_m=report.north_m,
            z_m=0.0,
            heading_rad=heading_rad(report.heading_deg),
            vx_m_s=report.east_m_s,
            vy_m_s=report.north_m_s,
            yaw_rate_rad_s=-math.radians(report.turn_deg_s),
            battery=report.charge_percent / 100.0,
            # What it says of who is in charge is about us only if it listens to us.
            controller=Controller(report.controller) if ours else None,
            goal_id=report.goal if ours else None,
            link=Link.UP,
        )
        self._latest = (state, report)
        self._heard += 1

    # --- the hooks -----------------------------------------------------------------------------------------

    def _connect(self, timeout_s: float) -> Capabilities:
        receiver, clock = self._receiver(), self.clock
        until_s = clock.steady_s() + timeout_s
        if not receiver.wait_for(lambda: self._heard >= _SETTLED_REPORTS, timeout_s):
            raise RobotUnavailable(
                f"robot {self.id}: {self._heard} reports were heard within {timeout_s:g} s; is its process running, "
                "and is its report address right?"
            )
        if not self._settle(until_s - clock.steady_s()):
            raise RobotUnavailable(f"robot {self.id}: {self._refusal()}")
        return self.declared

    def _send_goto(self, goal: Goal) -> None:
        target = goal.target
        heading_deg = None if target.heading_rad is None else compass_deg(target.heading_rad)
        self._send(goal=GoalMessage(
            goal.id, goal.by.value, target.y_m, target.x_m, heading_deg, target.speed_m_s
        ))  # fmt: skip

    def _sample(self) -> RobotState | None:
        latest = self._latest
        return None if latest is None else latest[0]

    def _hand_over(self, to: Controller) -> None:
        # One message shuts the old controller's stream and flushes its goal: the robot's gate drops it with the change.
        self._send(controller=to.value, goal=None)

    def _renew_lease(self) -> None:
        self._send(lease_s=self._vehicle_clock.to_vehicle_s(self.id, self.clock.now()))

    def _halt(self) -> None:
        self._send(goal=None)

    def _disconnect(self, timeout_s: float) -> None:
        if self._capabilities is not None and not self._commands.closed:
            self._command = self._command._replace(controller=Controller.SC.value, goal=None, lease_s=None)
            latest = self._latest
            lost = latest is None or self.clock.now() - latest[0].stamp_s > self.stale_after_s
            # Who is not heard any more has been stopped by its lease; it may still come back, but not many do.
            self._settle(min(timeout_s, _LOST_S) if lost else timeout_s)
        # The robot has heard it, or is not there: nothing is worth waiting for when the socket goes.
        self._commands.close(0)

    # --- the rest ------------------------------------------------------------------------------------------

    def _send(self, **changes: object) -> None:
        """Send the whole of what the robot is to do, with these changes, under a new number."""
        command = self._command._replace(seq=self._command.seq + 1, **changes)  # type: ignore[arg-type]
        self._command = command
        try:
            self._commands.send(command.encode(), zmq.NOBLOCK)
        except zmq.Again:
            # Nobody is there to take it. The next renewal says all of it again; until then the lease runs out.
            return

    def _settle(self, timeout_s: float) -> bool:
        """Repeat the command until the robot has taken it and stands still; return whether it does in time."""
        receiver, until_s = self._receiver(), self.clock.steady_s() + timeout_s
        while self.clock.steady_s() < until_s:
            self._send()
            if receiver.wait_for(self._follows_and_rests, _REPEAT_S):
                return True
        return False

    def _follows_and_rests(self) -> bool:
        """Return whether the robot has taken the last command and stands still."""
        latest = self._latest
        if latest is None:
            return False
        state, report = latest
        return (
            report.session == self._command.session
            and report.seq >= self._command.seq > 0
            and abs(state.vx_m_s) + abs(state.vy_m_s) <= _REST_M_S
            and abs(state.yaw_rate_rad_s) <= _REST_RAD_S
        )

    def _refusal(self) -> str:
        latest = self._latest
        if latest is not None and latest[1].session not in {"", self._command.session}:
            return "it follows somebody else, whose lease lives; end the other program that commands it"
        return "it reports, but takes no command; is its command address right?"

    def _receiver(self) -> Receiver:
        assert self.receiver is not None
        return self.receiver


class ZmqFleet(Fleet):
    """Robots, one thread that hears them, and the simulator if it was started for them.

    Args:
        config: where the robots are.
        specs: the robots.
        simulator: a simulator to end with the fleet, or None.

    Attributes:
        simulator: the same.
    """

    def __init__(self, config: ZmqConfig, specs: Sequence[RobotSpec], simulator: Simulator | None) -> None:
        endpoints = config.robots
        truth_address = config.truth
        if simulator is not None:
            endpoints = {robot_id: Endpoints(**each) for robot_id, each in simulator.endpoints.items()}
            truth_address = simulator.truth
        self.simulator: Final = simulator
        self._context: Final = zmq.Context()
        self._context.linger = 0
        clock = VehicleClock()
        robots = [ZmqRobot(spec, clock, self._connected(endpoints[spec.id].command)) for spec in specs]
        truth = ToldTruth(clock) if truth_address is not None else None
        sources: dict[str, Hear] = {endpoints[robot.id].report: robot.hear for robot in robots}
        if truth is not None and truth_address is not None:
            sources[truth_address] = lambda message, _: truth.hear(message)
        self._receiver: Final = Receiver(self._context, clock, sources)
        for robot in robots:
            robot.receiver = self._receiver
        super().__init__(clock, robots, truth)
        if truth is not None and not self._receiver.wait_for(lambda: truth.known, _TRUTH_TIMEOUT_S):
            self._close()
            raise RobotUnavailable(
                f"nobody says at {truth_address} what really happens; is the simulator running, and is 'truth' right?"
            )

    def _connected(self, address: str) -> zmq.Socket[bytes]:
        socket = self._context.socket(zmq.PUSH)
        socket.setsockopt(zmq.CONFLATE, 1)
        socket.setsockopt(zmq.RECONNECT_IVL, 50)
        socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
        socket.connect(address)
        return socket

    def _close(self) -> None:
        self._receiver.close()
        self._context.destroy()
        if self.simulator is not None:
            self.simulator.close()


class ZmqBackend(Backend):
    """Robots on ZeroMQ: those that are given, or simulated ones that are started for the occasion."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = ZmqConfig
    robot_class: ClassVar[type[Robot]] = ZmqRobot
    harness: ClassVar[str] = "soter_zmq.harness:ZmqHarness"

    def open(self, config: ZmqConfig, robots: Sequence[RobotSpec]) -> ZmqFleet:
        """Open the robots; they are not ready before `init()`.

        Raises:
            RobotUnavailable: a robot has no address, or the simulated ones do not start.
        """
        if not config.robots:
            simulator = Simulator(describe(config.workspace, robots))
            try:
                return ZmqFleet(config, robots, simulator)
            except BaseException:
                simulator.close()
                raise
        missing = [spec.id for spec in robots if spec.id not in config.robots]
        if missing:
            raise RobotUnavailable(
                f"no address is given for the robots {missing}; add them to [backends.zmq.robots], or take all out to "
                "have simulated ones"
            )
        return ZmqFleet(config, robots, None)

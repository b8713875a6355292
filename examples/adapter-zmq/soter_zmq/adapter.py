"""The backend `zmq`: robots that speak JSON over ZeroMQ, behind SOTER's narrow interface."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack, suppress
from typing import ClassVar, Final

import zmq
from pydantic import BaseModel, ConfigDict, Field, field_validator

from soter.clock import VehicleClock
from soter.onboard.command import Command, Report
from soter.sdk import INTERFACE_VERSION, BackendConfig, Capabilities, Robot, RobotSpec
from soter.sdk.commanded import CommandedRobot
from soter.sdk.wire import WireBackend, WireConfig
from soter_zmq.receiver import Receiver, opened
from soter_zmq.wire import decode_report, encode_command


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


class ZmqConfig(WireConfig):
    """Options of the backend `zmq`.

    Attributes:
        robots: by number, where the robots are; where none is given, simulated ones are started.
    """

    robots: dict[int, Endpoints] = Field(default_factory=dict)


class ZmqRobot(CommandedRobot):
    """One robot on the wire.

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
        v_max_m_s=0.22,
        yaw_rate_max_rad_s=2.84,
        brake_m_s2=1.0,
        body_radius_m=0.105,
        # Measured on a host with four times as much to do as it has cores: 0.036, 0.060 and 0.023 s at worst.
        latency_s=0.04,
        sample_age_s=0.07,
        jitter_s=0.03,
        setpoint_period_s=0.02,
        lease_s=0.15,
        tube_m=0.02,
        overshoot_m=0.01,
        # Positions are exact. Stamps move by a millisecond or so while the clocks' offset is learned; at top speed that
        # is this far.
        position_noise_m=0.001,
        pivots_first=True,
    )

    def __init__(self, spec: RobotSpec, clock: VehicleClock, commands: zmq.Socket[bytes]) -> None:
        super().__init__(spec, clock)
        self._commands: Final = commands

    def _publish(self, message: bytes) -> None:
        with suppress(zmq.Again):
            self._commands.send(message, zmq.NOBLOCK)

    def _encode(self, command: Command) -> bytes:
        return encode_command(command)

    def _decode(self, message: bytes) -> Report:
        return decode_report(message)


class ZmqBackend(WireBackend):
    """Robots on ZeroMQ: those that are given, or simulated ones that are started for the occasion."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = ZmqConfig
    robot_class: ClassVar[type[Robot]] = ZmqRobot
    simulated_by: ClassVar[str] = "soter_zmq.robot"
    harness: ClassVar[str] = "soter_zmq.harness:ZmqHarness"

    def connect(
        self, config: ZmqConfig, robots: Sequence[RobotSpec], clock: VehicleClock, shared: ExitStack
    ) -> Sequence[Robot]:
        context = zmq.Context()
        context.linger = 0
        shared.callback(context.destroy)
        made = [ZmqRobot(each, clock, opened(context, zmq.PUSH, config.robots[each.id].command)) for each in robots]
        receiver = Receiver(context, {config.robots[each.id].report: each.receive for each in made})
        shared.callback(receiver.close)
        return made

"""The backend `lcm`: robots that speak LCM, behind SOTER's narrow interface."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import ExitStack
from typing import ClassVar

from pydantic import Field, field_validator

from soter.clock import VehicleClock
from soter.onboard.command import Command, Report
from soter.sdk import INTERFACE_VERSION, BackendConfig, Capabilities, Robot, RobotSpec
from soter.sdk.commanded import CommandedRobot
from soter.sdk.wire import WireBackend, WireConfig
from soter_lcm.bus import Bus
from soter_lcm.wire import command_channel, decode_report, encode_command, report_channel


class LcmConfig(WireConfig):
    """Options of the backend `lcm`.

    Attributes:
        robots: by number, the bus that the robots are on; where none is given, simulated ones are started.
    """

    robots: dict[int, str] = Field(default_factory=dict)

    @field_validator("robots")
    @classmethod
    def _stay_here(cls, robots: dict[int, str]) -> dict[int, str]:
        # LCM neither encrypts nor signs. A bus elsewhere is reached through a tunnel that does.
        for robot_id, url in robots.items():
            if not re.fullmatch(r"udpm://239\.255\.\d+\.\d+:\d+\?ttl=0", url):
                raise ValueError(f"robot {robot_id} is on {url!r}, allowed: udpm://239.255.N.N:PORT?ttl=0")
        return robots


class LcmRobot(CommandedRobot):
    """One robot on the bus.

    Args:
        spec: which robot.
        clock: follows the robots' clocks.
    """

    # What SOTER's proofs stand on. Each number is the worst that may happen on the machine where it will run, with all
    # that else runs there; `soter conform` measures them.
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
        latency_s=0.04,
        sample_age_s=0.07,
        jitter_s=0.03,
        setpoint_period_s=0.02,
        lease_s=0.15,
        tube_m=0.02,
        overshoot_m=0.01,
        position_noise_m=0.001,
        pivots_first=True,
    )

    bus: Bus

    def _publish(self, message: bytes) -> None:
        self.bus.say(command_channel(self.id), message)

    def _encode(self, command: Command) -> bytes:
        return encode_command(command)

    def _decode(self, message: bytes) -> Report:
        return decode_report(message)


class LcmBackend(WireBackend):
    """Robots on LCM: those that are given, or simulated ones that are started for the occasion."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = LcmConfig
    robot_class: ClassVar[type[Robot]] = LcmRobot
    simulated_by: ClassVar[str] = "soter_lcm.robots"
    harness: ClassVar[str] = "soter_lcm.harness:LcmHarness"

    def connect(
        self, config: LcmConfig, robots: Sequence[RobotSpec], clock: VehicleClock, shared: ExitStack
    ) -> Sequence[Robot]:
        made = [LcmRobot(spec, clock) for spec in robots]
        for url in sorted({config.robots[each.id] for each in made}):
            here = [each for each in made if config.robots[each.id] == url]
            bus = Bus(url, {report_channel(each.id): each.receive for each in here})
            shared.callback(bus.close)
            for robot in here:
                robot.bus = bus
            bus.listen("lcm")
        return made

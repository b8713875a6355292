"""The backend `mavlink`: vehicles at a given connection, or simulated ones that the backend starts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import ClassVar, Final

from soter.adapters.mavlink.authority import COMPONENTS
from soter.adapters.mavlink.held_missions import read_missions
from soter.adapters.mavlink.link import Inbox, MavlinkLink
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.robot import MavlinkRobot
from soter.adapters.mavlink.simulator import MavlinkSimulator, free_port
from soter.adapters.mavlink.transport import Address
from soter.clock import Clock, VehicleClock
from soter.errors import ConfigError, RobotUnavailable, Unsupported
from soter.sdk import INTERFACE_VERSION, Backend, BackendConfig, Capabilities, HeldMission, Robot, RobotSpec
from soter.sdk.wire import WireFleet, describe

_SYSTEM_MOST: Final = 254

# Largest difference in rate between two quartz clocks; a simulated vehicle slows down with a host that lags.
_CRYSTAL: Final = 1e-3
_SIMULATED: Final = 0.2


class MavlinkFleet(WireFleet[MavlinkSimulator]):
    """Vehicles on one link, and the simulator if it was started for them."""


class VehicleBackend(Backend):
    """The common part of the backends `mavlink` and `mavsdk`: all but the MAVLink library."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = MavlinkConfig
    robot_class: ClassVar[type[Robot]] = MavlinkRobot

    @classmethod
    def promises(cls, config: MavlinkConfig) -> Capabilities:
        return config.promised()

    def open(self, config: MavlinkConfig, robots: Sequence[RobotSpec]) -> MavlinkFleet:
        """Open the link, and start simulated vehicles if none are given; vehicles get ready in `init()`.

        Raises:
            ConfigError: the options cannot be used.
            RobotUnavailable: the link cannot be opened, or the simulated vehicles do not start.
        """
        for spec in robots:
            if not 1 <= spec.id <= _SYSTEM_MOST or spec.id == config.system_id:
                raise RobotUnavailable(
                    f"robot {spec.id}: its id is no system id of a vehicle, allowed: 1 to {_SYSTEM_MOST}, other than "
                    f"our own, {config.system_id}"
                )
        simulated = config.connection is None
        tolerance = _SIMULATED if simulated or config.truth is not None else _CRYSTAL
        clock = VehicleClock(rate=config.speedup, rate_tolerance=tolerance)
        port = free_port() if simulated else 0
        # Robots opened by hand may come without a promise: the options' promise counts then.
        robots = [replace(spec, promised=spec.promised or config.promised()) for spec in robots]
        simulator: MavlinkSimulator | None = None
        with ExitStack() as started, ExitStack() as shared:
            link = self._link(clock, Address.parse(config.connection or f"udpin:127.0.0.1:{port}"), config)
            shared.callback(link.close)
            for spec in robots:
                link.inboxes[spec.id] = Inbox()
            vehicles: list[MavlinkRobot] = []
            vehicles += [MavlinkRobot(spec, clock, link, config, vehicles) for spec in robots]
            link.start()
            if simulated:
                simulator = MavlinkSimulator(describe(config.workspace, robots, config.limits), port, *_options(config))
                started.callback(simulator.close)
            truth = config.truth if simulator is None else simulator.truth
            fleet = MavlinkFleet(clock, vehicles, truth, simulator, shared)
            started.pop_all()
            return fleet

    def read_missions(
        self, config: MavlinkConfig, robot_ids: Sequence[int], timeout_s: float
    ) -> dict[int, HeldMission]:
        """Ask vehicles for the missions that ground stations have sent them.

        Raises:
            Unsupported: no vehicle is given, and simulated ones hold no mission.
            RobotUnavailable: the link cannot be opened, or a vehicle does not answer in time.
        """
        if config.connection is None:
            raise Unsupported("no vehicles are given that could hold a mission; give a connection to some")
        clock = VehicleClock()
        with closing(self._link(clock, Address.parse(config.connection), config)) as link:
            for robot_id in robot_ids:
                link.inboxes[robot_id] = Inbox()
            link.start()
            return read_missions(link, robot_ids, config.geo_origin, timeout_s)

    @abstractmethod
    def _link(self, clock: Clock, address: Address, config: MavlinkConfig) -> MavlinkLink:
        """Make the link without opening it."""


class MavlinkBackend(VehicleBackend):
    """Vehicles on MAVLink 2, by pymavlink."""

    harness: ClassVar[str] = "soter.adapters.mavlink.harness:MavlinkHarness"

    def _link(self, clock: Clock, address: Address, config: MavlinkConfig) -> MavlinkLink:
        from soter.adapters.mavlink.pymavlink_link import PymavlinkLink, signing_key

        try:
            passphrase = config.read_passphrase()
        except (OSError, ValueError) as failure:
            raise ConfigError(str(failure), key="passphrase_file") from failure
        key = None if passphrase is None else signing_key(passphrase)
        return PymavlinkLink(clock, address, config.system_id, COMPONENTS, key)


def _options(config: MavlinkConfig) -> list[str]:
    vehicle = ["--like", "ardurover-boat"] if config.vehicle == "boat" else ["--vehicle", config.vehicle]
    options = [*vehicle, "--speedup", repr(config.speedup), "--boot", repr(config.boot_s)]
    options += ["--engine", "pybullet"] if config.has_bodies else ["--rate", repr(config.stream_hz)]
    return options if config.passphrase_file is None else [*options, "--sign", str(config.passphrase_file)]

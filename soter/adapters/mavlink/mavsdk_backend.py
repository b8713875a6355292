"""The backend `mavsdk`: the vehicles of the backend `mavlink`, by MAVSDK instead of pymavlink."""

from __future__ import annotations

from typing import ClassVar

from soter.adapters.mavlink.authority import COMPONENTS
from soter.adapters.mavlink.backend import VehicleBackend
from soter.adapters.mavlink.link import MavlinkLink
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.transport import Address
from soter.clock import Clock
from soter.errors import ConfigError


class MavsdkBackend(VehicleBackend):
    """Vehicles on MAVLink 2, by MAVSDK."""

    harness: ClassVar[str] = "soter.adapters.mavlink.harness:MavsdkHarness"

    def _link(self, clock: Clock, address: Address, config: MavlinkConfig) -> MavlinkLink:
        # Imported here, so that the class can be imported without the library.
        from soter.adapters.mavlink.mavsdk_link import MavsdkLink

        if config.passphrase_file is not None:
            raise ConfigError("MAVSDK's Python binding cannot sign; use the backend 'mavlink'", key="passphrase_file")
        return MavsdkLink(clock, address, config.system_id, COMPONENTS)

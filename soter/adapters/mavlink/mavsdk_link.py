"""MAVLink 2 by MAVSDK, which receives, decodes, packs and sends in this process.

MAVSDK's telemetry carries no stamps, and its offboard plugin repeats the last target by itself, which would defeat the
lease. So messages go through its direct interface: each one comes as JSON, and each of our components is a server
component of MAVSDK with its own component id. MAVSDK cannot sign, and cannot be silent: it sends heartbeats of every
component for as long as the process lives.
"""

from __future__ import annotations

import json
import logging
import math
import os
import socket
import tempfile
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Final

import mavsdk
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.plugins.mavlink_direct_server.mavlink_direct_server import (
    MavlinkDirectServer,
    MavlinkDirectServerError,
    MavlinkMessage,
)

from soter.adapters.mavlink.link import AUTOPILOT, Fields, MavlinkLink
from soter.adapters.mavlink.transport import Address
from soter.clock import Clock
from soter.errors import RobotUnavailable
from soter.scratch import Scratch

logger = logging.getLogger(__name__)

_EVERYTHING: Final = ""
_LEVELS: Final = {LogLevel.WARN: logging.INFO, LogLevel.ERROR: logging.INFO}


class MavsdkLink(MavlinkLink):
    """A link that MAVSDK runs. Its thread calls us with every message."""

    def __init__(self, clock: Clock, address: Address, system: int, components: Sequence[int]) -> None:
        super().__init__(clock, system)
        self._address: Final = address
        self._components: Final = tuple(components)
        self._senders: Final[dict[int, MavlinkDirectServer]] = {}
        self._mavsdk: mavsdk.Mavsdk | None = None
        self._scratch: Scratch | None = None

    def start(self) -> None:
        if self._address.kind == "udpin" and _in_use(self._address):
            # MAVSDK would report success, and receive nothing.
            raise RobotUnavailable(f"connection '{self._address}' is in use; end the other program that listens there")
        log_subscribe(_log)
        keeper = self._components[0]
        configuration = mavsdk.Configuration.create_manual(self.system, keeper, True)
        # MAVSDK makes a folder for each vehicle in TMPDIR, and leaves it behind if this process is killed. Only the
        # library sees this TMPDIR: programs started from here get `os.environ`.
        self._scratch = Scratch("mavsdk")
        os.putenv("TMPDIR", str(self._scratch.path))
        self._mavsdk = started = mavsdk.Mavsdk(configuration)
        configuration.destroy()
        for component in self._components:
            self._senders[component] = MavlinkDirectServer(started.server_component_by_id(component))
        self._senders[keeper].subscribe_message(_EVERYTHING, self._hear)
        result = started.add_any_connection(self._address.mavsdk_url)
        if result is not mavsdk.ConnectionResult.SUCCESS:
            self.close()
            raise RobotUnavailable(f"connection '{self._address}' cannot be opened: {result.name}")

    def beat(self, system: int) -> None:
        """Do nothing: MAVSDK sends heartbeats by itself."""

    def close(self) -> None:
        started, self._mavsdk = self._mavsdk, None
        if started is not None:
            self._senders.clear()
            started.destroy()
        if self._scratch is not None:
            os.putenv("TMPDIR", tempfile.gettempdir())
            self._scratch.close()

    def _send(self, system: int, component: int, name: str, fields: Fields) -> None:
        sender = self._senders.get(component)
        if sender is None:
            return
        try:
            sender.send_message(MavlinkMessage(name, 0, 0, system, AUTOPILOT, json.dumps(dict(fields))))
        except MavlinkDirectServerError as failure:
            logger.debug("not sent: %s", failure)

    # --- MAVSDK's thread -----------------------------------------------------------------------------------

    def _hear(self, message: MavlinkMessage, _user_data: object) -> None:
        received_s = self.clock.steady_s()
        try:
            self._take(message, received_s)
        except Exception as failure:  # noqa: BLE001 - MAVSDK would print it
            self._dropped("a message", failure)

    def _take(self, message: MavlinkMessage, received_s: float) -> None:
        if message.component_id != AUTOPILOT:
            return
        inbox = self.inboxes.get(message.system_id)
        if inbox is None:
            self.strangers.add(message.system_id)
            return
        # JSON has no NaN.
        fields = json.loads(message.fields_json, parse_constant=lambda _: math.nan)
        values = {key: math.nan if value is None else value for key, value in fields.items()}
        inbox.put(message.message_name, SimpleNamespace(**values), received_s)


def _log(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """Log a message of MAVSDK, which must not write to the terminal."""
    logger.log(_LEVELS.get(level, logging.DEBUG), "MAVSDK: %s", message)
    return True


def _in_use(address: Address) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address.host, address.port))
        except OSError:
            return True
    return False

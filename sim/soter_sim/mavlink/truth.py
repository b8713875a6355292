"""What really happens, on a channel of its own: lines of JSON over TCP, told by the world and not by the vehicles.

The package's docstring says what stands in a line.
"""

from __future__ import annotations

import json
import selectors
from collections.abc import Sequence
from math import isfinite
from typing import Any, Final

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.stream import HOST, Connection, Server
from soter_sim.world import World

LINE_MOST: Final = 1 << 16
"""A line is never longer than this, in bytes."""

# So many ended violations fit into a line beside 100 robots.
_CLOSED_MOST: Final = 200


class TruthServer:
    """Tells the truth to whoever connects.

    Nobody can hold up the world: who reads slowly gets fewer lines, but is told of every violation.

    Args:
        selector: calls what it is registered with when there is something to read or room to write.
        world: what it tells of.
        autopilots: whose clocks it tells.
        port: to listen on; 0 for any that is free.

    Attributes:
        address: where it listens, `host:port`.

    Raises:
        OSError: the port is taken.
    """

    def __init__(
        self, selector: selectors.BaseSelector, world: World, autopilots: Sequence[Autopilot], port: int
    ) -> None:
        self._world = world
        self._autopilots = autopilots
        # By reader, how many ended violations it was told of.
        self._told: dict[Connection, int] = {}
        self._server: Final = Server(selector, port, opened=self._opened, received=_ignored, gone=self._gone)
        self.address: Final = f"{HOST}:{self._server.port}"

    def tell(self) -> None:
        """Send a line to everybody who has taken the one before."""
        readers = [reader for reader in self._told if reader.idle]
        if not readers:
            return
        now = self._now()
        closed = self._world.engine.record.closed
        for reader in readers:
            begin = self._told[reader]
            part = closed[begin : begin + _CLOSED_MOST]
            self._told[reader] = begin + len(part)
            ended = [(each.rule, each.robots, each.start_s, each.end_s) for each in part]
            reader.write(json.dumps(now | {"closed_before": begin, "closed": ended}).encode() + b"\n")

    def close(self) -> None:
        """Close the sockets."""
        self._server.close()

    def _now(self) -> dict[str, Any]:
        record = self._world.engine.record
        robots = {}
        for autopilot in self._autopilots:
            at = autopilot.sample()
            robots[autopilot.id] = {
                "pose": (at.x_m, at.y_m, at.z_m, at.heading_rad),
                "velocity": (at.east_m_s, at.north_m_s, at.up_m_s, at.yaw_rate_rad_s),
                "charge": at.charge,
                "booted_s": autopilot.booted_s,
            }
        return {
            "time_s": self._world.now_s,
            "robots": robots,
            "open": [(rule, robots_of, at_s) for (rule, robots_of), at_s in record.open.items()],
            # JSON knows no infinity: a world without boxes has no margin to them.
            "min_margin": {rule: margin for rule, margin in record.min_margin.items() if isfinite(margin)},
            "contacts": record.box_contacts + record.robot_contacts,
            "robot_contacts": record.robot_contacts,
        }

    def _opened(self, reader: Connection) -> None:
        self._told[reader] = 0

    def _gone(self, reader: Connection) -> None:
        del self._told[reader]


def _ignored(_reader: Connection, _data: bytes) -> None:
    """Drop what a reader says: the truth cannot be argued with."""

"""Serves the ground truth of a world to all that connect: JSON lines over TCP, on this host only.

One line, sent after every step that the world's owner chooses to report:

```
{"time_s": 12.5,
 "poses": {"1": [x_m, y_m, heading_rad]}, "speeds": {"1": [v_m_s, yaw_rate_rad_s]}, "charges": {"1": 0.93},
 "violations": [["geofence", [1], 3.2, 4.1]], "min_margin": {"geofence": -0.1}, "contacts": 0}
```

`soter.sdk.truth.StreamedTruth` reads it. A present violation has the end `null`. Times are the world's.
"""

from __future__ import annotations

import json
import socket
from typing import Any, Final

from soter_sim.world import World

_LARGEST_BACKLOG: Final = 1 << 20
"""Bytes that a reader may fall behind before it is disconnected: a world does not wait."""


class TruthServer:
    """Serves the truth of one world on a socket. Never blocks; used from the thread that moves the world.

    Args:
        world: the world.
        port: port to listen on; 0 for any free one.
    """

    def __init__(self, world: World, port: int = 0) -> None:
        self._world: Final = world
        self._listener: Final = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self._readers: Final[dict[socket.socket, bytearray]] = {}

    @property
    def address(self) -> str:
        """The address that it listens on, `host:port`."""
        host, port = self._listener.getsockname()
        return f"{host}:{port}"

    def tell(self) -> None:
        """Send the present truth to all readers."""
        self._accept()
        if not self._readers:
            return
        line = json.dumps(self._told(), separators=(",", ":")).encode() + b"\n"
        for reader, backlog in [*self._readers.items()]:
            backlog += line
            try:
                del backlog[: reader.send(backlog)]
            except BlockingIOError:
                pass
            except OSError:
                self._let_go(reader)
                continue
            if len(backlog) > _LARGEST_BACKLOG:
                self._let_go(reader)

    def close(self) -> None:
        """Close the sockets. Idempotent."""
        for reader in [*self._readers]:
            self._let_go(reader)
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                reader, _ = self._listener.accept()
            except OSError:
                return
            reader.setblocking(False)
            reader.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._readers[reader] = bytearray()

    def _let_go(self, reader: socket.socket) -> None:
        del self._readers[reader]
        reader.close()

    def _told(self) -> dict[str, Any]:
        world, bodies = self._world, self._world.bodies
        report = world.truth.report()
        indices = [*enumerate(bodies.ids)]
        return {
            "time_s": world.now_s,
            "poses": {robot_id: (bodies.x[i], bodies.y[i], bodies.heading[i]) for i, robot_id in indices},
            "speeds": {robot_id: (bodies.v[i], bodies.yaw_rate[i]) for i, robot_id in indices},
            "charges": {robot_id: bodies.charge[i] for i, robot_id in indices},
            "violations": [(each.rule, each.robots, each.start_s, each.end_s) for each in report.violations],
            "min_margin": dict(report.min_margin),
            "contacts": report.contacts,
        }

"""Shows a run in the Foxglove app: a server on 127.0.0.1 that passes on the recording, on the same channels.

The only module that knows foxglove-sdk. The SDK has a queue for each client, of which it drops the oldest messages.
"""

from __future__ import annotations

import socket
import time
from collections import deque
from typing import Final

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.websocket import Capability, ChannelView, Client, ServerListener, StatusLevel, WebSocketServer

from soter.live.view import HOST
from soter.record.file import channels, definition
from soter.record.follow import GrowingRecording
from soter.record.foxglove import Log
from soter.record.messages import schema_name

FLUSH_S: Final = 0.5
"""Host time that clients have at the end to receive the queued messages."""

SETTLED_S: Final = 0.2
"""Host time after which a subscription surely counts: the SDK reports it a moment too early."""

_STAYS: Final = "foxglove."
_PASSES: Final = schema_name(Log)


class AppScreen(ServerListener):
    """Passes a run on to the Foxglove app; a `soter.live.process.Screen`.

    The port is held from the beginning, but served only once all channels are known, so that a client gets all of them
    when it connects.
    """

    def __init__(self, port: int) -> None:
        self._context: Final = Context()
        self._channels: Final[dict[str, Channel]] = {}
        self._last: Final[dict[str, bytes]] = {}
        self._asked: Final[deque[tuple[float, str]]] = deque()
        self._time_ns = 0
        self._server: WebSocketServer | None = None
        self._held: Final = socket.socket()
        self._held.bind((HOST, port))
        self.port: Final = int(self._held.getsockname()[1])

    def show(self, recording: GrowingRecording) -> None:
        for topic, kind in channels(robot.robot_id for robot in recording.about.robots).items():
            schema = Schema(name=schema_name(kind), encoding="jsonschema", data=definition(kind))
            self._channels[topic] = Channel(topic, schema=schema, message_encoding="json", context=self._context)
        server = self._server = self._serve()
        for topic, schema_of, _, data, time_ns in recording.raw():
            if schema_of.startswith(_STAYS) and schema_of != _PASSES:
                self._last[topic] = data
            if time_ns > self._time_ns:
                self._time_ns = time_ns
                server.broadcast_time(time_ns)
            self._channels[topic].log(data, log_time=time_ns)
            self._repeat()

    def pause(self) -> None:
        self._repeat()

    def close(self) -> None:
        self._held.close()
        if self._server is not None:
            self._server.publish_status("The run has ended.", StatusLevel.Info)
            # The SDK sends in threads of its own, and does not report when they are done.
            time.sleep(FLUSH_S)
            self._server.stop()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Note a new client, which may have missed messages that are sent once. Called by a thread of the SDK."""
        self._asked.append((time.monotonic(), channel.topic))

    def _serve(self) -> WebSocketServer:
        self._held.close()
        try:
            return foxglove.start_server(
                name="SOTER", host=HOST, port=self.port, capabilities=[Capability.Time], server_listener=self,
                context=self._context,
            )  # fmt: skip
        except RuntimeError as failure:
            raise OSError(str(failure)) from failure

    def _repeat(self) -> None:
        """Resend messages that are sent once and still hold, such as the boxes, for new clients."""
        while self._asked and time.monotonic() - self._asked[0][0] > SETTLED_S:
            _, topic = self._asked.popleft()
            if topic in self._last:
                self._channels[topic].log(self._last[topic], log_time=self._time_ns)

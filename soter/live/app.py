"""A run in the Foxglove app: a server on 127.0.0.1 that passes on what is recorded, on the channels of the recording.

The only module that knows foxglove-sdk. The SDK has a queue for each client, of which it drops the oldest messages.
"""

from __future__ import annotations

import time
from typing import BinaryIO, Final, NoReturn

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.websocket import Capability, ChannelView, Client, ServerListener, StatusLevel

from soter.live.process import serve
from soter.live.view import HOST
from soter.record.follow import GrowingRecording
from soter.record.foxglove import Log, schema_name

FLUSH_S: Final = 0.5
"""Host time that clients have at the end for what waits for them."""

_STAYS: Final = "foxglove."
_PASSES: Final = schema_name(Log)


class AppScreen(ServerListener):
    """Passes a run on to the Foxglove app.

    Args:
        port: of 127.0.0.1; 0 for one that is free.

    Raises:
        OSError: the port cannot be had.
    """

    def __init__(self, port: int) -> None:
        self._context: Final = Context()
        self._channels: Final[dict[str, Channel]] = {}
        self._last: Final[dict[str, bytes]] = {}
        self._time_ns = 0
        try:
            self._server: Final = foxglove.start_server(
                name="SOTER", host=HOST, port=port, capabilities=[Capability.Time], server_listener=self,
                context=self._context,
            )  # fmt: skip
        except RuntimeError as failure:
            raise OSError(str(failure)) from failure

    @property
    def port(self) -> int:
        return self._server.port

    def show(self, recording: GrowingRecording) -> None:
        for topic, schema, definition, data, time_ns in recording.raw():
            channel = self._channels.get(topic)
            if channel is None:
                described = Schema(name=schema, encoding="jsonschema", data=definition)
                channel = Channel(topic, schema=described, message_encoding="json", context=self._context)
                self._channels[topic] = channel
            if schema.startswith(_STAYS) and schema != _PASSES:
                self._last[topic] = data
            if time_ns > self._time_ns:
                self._time_ns = time_ns
                self._server.broadcast_time(time_ns)
            channel.log(data, log_time=time_ns)

    def pause(self) -> None:
        """Do nothing: everything was passed on as it came."""

    def close(self) -> None:
        self._server.publish_status("The run has ended.", StatusLevel.Info)
        # The SDK sends by threads of its own, and does not say when they are done.
        time.sleep(FLUSH_S)
        self._server.stop()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Say again what was said once and still holds, such as where the boxes are: this client came later."""
        last = self._last.get(channel.topic)
        if last is not None:
            self._channels[channel.topic].log(last, log_time=self._time_ns)


def main(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> NoReturn:
    """Be the process that `soter.live.view` starts."""
    serve(stdin, socket_fd, lifeline_fd, AppScreen)

"""The server for the Foxglove app, heard by a client of its protocol that is not the SDK's."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from soter.live.view import APP, LiveView
from soter.record.reader import Recording
from soter.runner import Follower, run_mission
from tests.live.growing import Growing
from tests.record.helpers import every_message, mission
from tests.waiting import wait_until

pytest.importorskip("foxglove", reason="NOT RUN: the app was served nothing, foxglove-sdk is not installed")
client = pytest.importorskip("websockets.sync.client", reason="NOT RUN: nobody heard, websockets is not installed")

SUBPROTOCOL = "foxglove.sdk.v1"
MESSAGE_DATA = 1
TIME = 2
WAIT_S = 30.0


class Client:
    """Subscribes to everything that is advertised, and keeps what it hears.

    Attributes:
        schemas: by topic: name and definition.
        heard: topic, time in nanoseconds and data, in order.
        times_ns: the server's.
        words: of its status messages.
    """

    def __init__(self, connection: Any) -> None:
        self._connection = connection
        self._topics: dict[int, str] = {}
        self.schemas: dict[str, tuple[str, bytes]] = {}
        self.heard: list[tuple[str, int, bytes]] = []
        self.times_ns: list[int] = []
        self.words: list[str] = []

    def hear(self) -> None:
        """Take the next message."""
        message = self._connection.recv(timeout=WAIT_S)
        if isinstance(message, str):
            self._control(json.loads(message))
        elif message[0] == MESSAGE_DATA:
            subscription, time_ns = struct.unpack_from("<IQ", message, 1)
            self.heard.append((self._topics[subscription], time_ns, message[13:]))
        elif message[0] == TIME:
            self.times_ns.append(struct.unpack_from("<Q", message, 1)[0])

    def hear_all(self) -> None:
        """Take everything until the server closes the connection."""
        from websockets.exceptions import ConnectionClosed

        try:
            while True:
                self.hear()
        except ConnectionClosed:
            return

    def _control(self, message: dict[str, Any]) -> None:
        if message["op"] == "advertise":
            for channel in message["channels"]:
                self._topics[channel["id"]] = channel["topic"]
                assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
                self.schemas[channel["topic"]] = channel["schemaName"], channel["schema"].encode()
            wanted = [{"id": each["id"], "channelId": each["id"]} for each in message["channels"]]
            self._connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        elif message["op"] == "status":
            self.words.append(message["message"])


@contextmanager
def connected(view: LiveView) -> Iterator[Client]:
    """A client, as soon as the server is there."""
    found: list[Any] = []

    def connect() -> bool:
        with suppress(ConnectionRefusedError):
            found.append(client.connect(view.address, subprotocols=[SUBPROTOCOL], max_size=None, close_timeout=0.1))
        return bool(found)

    wait_until(connect)
    with found[0] as connection:
        yield Client(connection)


def test_a_client_follows_the_robots_of_a_run_that_goes_on(whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    growing.to(0.6)
    with LiveView(APP) as view:
        view.begin(growing.path)
        with connected(view) as heard:
            while not any(topic == "/tf" for topic, _, _ in heard.heard):
                heard.hear()
            first_ns = heard.heard[-1][1]
            growing.to(1.0)
            view.close()
            heard.hear_all()
    assert heard.words == ["The run has ended."]
    assert heard.times_ns == sorted(heard.times_ns)
    known = {(topic, schema, definition) for topic, schema, definition, _ in every_message(whole)}
    assert {(topic, *schema) for topic, schema in heard.schemas.items()} >= known
    content = Recording(whole).content()
    later = 0
    for topic, time_ns, data in heard.heard:
        if topic != "/tf":
            continue
        for each in json.loads(data)["transforms"]:
            stamp = each["timestamp"]
            series = content.series[int(each["child_frame_id"].removeprefix("robot"))]
            index = round((stamp["sec"] + stamp["nsec"] / 1e9) / 0.05)
            assert each["translation"]["x"] == pytest.approx(series.x_m[index], abs=1e-5)
            assert each["translation"]["y"] == pytest.approx(series.y_m[index], abs=1e-5)
        later += time_ns > first_ns
    assert later > 10


def test_who_comes_late_is_told_what_still_holds(whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    growing.to(0.6)
    with LiveView(APP) as view:
        view.begin(growing.path)
        with connected(view) as early:
            while not any(topic == "/tf" for topic, _, _ in early.heard):
                early.hear()
        with connected(view) as late:
            while not {"/scene", "/robots/1/scene", "/tf"} <= {topic for topic, _, _ in late.heard}:
                late.hear()
    scene = next(json.loads(data) for topic, _, data in late.heard if topic == "/scene")
    assert len(scene["entities"][0]["cubes"]) == 5


def test_serving_the_app_costs_a_run_no_decision(tmp_path: Path) -> None:
    with LiveView(APP) as view, ExitStack() as stack:

        def begin(path: Path) -> None:
            view.begin(path)
            # This client reads nothing while the run goes on.
            stack.enter_context(connected(view))

        run = run_mission(mission(duration_s=60.0), record=tmp_path / "run.mcap", follower=Follower(recording=begin))
    assert run.result.trace_sha256 == run_mission(mission(duration_s=60.0)).result.trace_sha256

"""The live page: a small HTTP server on 127.0.0.1 for the page of a run that goes on, and for its news.

It serves these two and nothing else, and only to requests that name this host: those of a foreign page by DNS rebinding
name another one. No request has any effect on the run.
"""

from __future__ import annotations

import io
import math
import secrets
import socket
import threading
import time
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from soter.live.event_buffer import EventBuffer, FellBehind
from soter.live.view import HOST
from soter.record.content import RecordedTick
from soter.record.follow import GrowingRecording
from soter.report.page.html import GrowingPage

PUBLISH_S: Final = 0.25
"""Host time between two parts if there is always something new."""

VIEWER_S: Final = 3.0
"""Host time after which a viewer is dropped that does not read, or does not finish its request."""

ALIVE_S: Final = 2.0
"""Host time after which a message is sent even without news, so that a dead viewer is noticed."""

END_S: Final = 2.0
"""Host time that viewers have at the end to receive how the run ended."""

MOST_VIEWERS: Final = 64
"""Most viewers that listen, and most that request something, at a time."""

MOST_THREADS: Final = 4 * MOST_VIEWERS
SEND_BYTES: Final = 1 << 16
"""Most bytes that the system buffers for a viewer that does not read. Unsent parts are kept once for all viewers."""

_WAITING: Final = b"""\
<!doctype html><meta charset="utf-8"><meta name="color-scheme" content="light dark">
<meta name="viewport" content="width=device-width"><meta http-equiv="refresh" content="1"><title>SOTER</title>
<style>p { font: 17px/1.5 system-ui, sans-serif; margin: 18vh 8vw; text-align: center }</style>
<p>Starting. The run is shown here as soon as it begins."""


class PageScreen:
    """Serves the page of a run; a `soter.live.process.Screen`.

    `show` runs in the thread that made the screen; every viewer has a thread of its own.
    """

    def __init__(self, port: int) -> None:
        self.events: Final = EventBuffer()
        self.token: Final = secrets.token_urlsafe(9)
        self._lock: Final = threading.Lock()
        self._page: GrowingPage | None = None
        self._goes_on = True
        self._whole = (-1, b"")
        self._ticks: list[RecordedTick] = []
        self._published_s = 0.0
        self._server: Final = _Server((HOST, port), self)
        self.port: Final = int(self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, name="http", daemon=True).start()

    def show(self, recording: GrowingRecording) -> None:
        self._page = GrowingPage(recording)
        for tick in recording.ticks():
            self._ticks.append(tick)
            if time.monotonic() - self._published_s >= PUBLISH_S:
                self._publish()
        self._goes_on = False
        self._publish()

    def pause(self) -> None:
        if self._ticks:
            self._publish()

    def close(self) -> None:
        self.events.end()
        until_s = time.monotonic() + END_S
        while self._server.streams and time.monotonic() < until_s:
            time.sleep(0.01)

    def whole(self) -> bytes | None:
        """Return the page of the run up to now; None before its first tick. Any thread may call this."""
        with self._lock:
            number = self.events.count
            if self._page is None or not number:
                return None
            if self._whole[0] != number:
                stream = f"stream?run={self.token}&after={number}"
                self._whole = number, self._page.whole(stream, goes_on=self._goes_on).encode()
            return self._whole[1]

    def _publish(self) -> None:
        with self._lock:
            if self._page is not None:
                self.events.add(self._page.add(self._ticks, goes_on=self._goes_on).encode())
        self._ticks.clear()
        self._published_s = time.monotonic()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = MOST_VIEWERS

    def __init__(self, address: tuple[str, int], screen: PageScreen) -> None:
        self.screen: Final = screen
        self._room: Final = threading.Semaphore(MOST_THREADS)
        self._lock: Final = threading.Lock()
        self._asking: Final[dict[socket.socket, None]] = {}
        self._listening: Final[dict[socket.socket, float]] = {}
        super().__init__(address, _Viewer)
        port = int(self.server_address[1])
        self.names: Final = {f"{HOST}:{port}", f"localhost:{port}"}

    @property
    def streams(self) -> int:
        """How many viewers listen."""
        return len(self._listening)

    def server_bind(self) -> None:
        """Bind without looking up the name of this host, which the base class does."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = HOST, int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread. If there are too many requests at once, drop the oldest for the newest."""
        if not self._room.acquire(blocking=False):
            self.shutdown_request(request)
            return
        with self._lock:
            if len(self._asking) >= MOST_VIEWERS:
                _drop(self._asking)
            self._asking[request] = None
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def shutdown_request(self, request: Any) -> None:
        """Forget a viewer, and close its connection."""
        with self._lock:
            self._asking.pop(request, None)
            self._listening.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Drop a viewer that has left or does not read, without logging: the run is not at fault."""

    def listens(self, viewer: socket.socket) -> None:
        """Give a viewer a place among those that listen.

        If there is none, the viewer that is slowest to read loses its place, or else the oldest: one that never
        reads looks like the others until the system's buffer for it is full.
        """
        with self._lock:
            if len(self._listening) >= MOST_VIEWERS:
                slowest = min(self._listening, key=self._listening.__getitem__)
                del self._listening[slowest]
                _drop({slowest: None})
            self._asking.pop(viewer, None)
            self._listening[viewer] = math.inf

    def tells(self, viewer: socket.socket, since_s: float) -> None:
        """Note since when data are being sent to a viewer; infinite if none are."""
        with self._lock:
            if viewer in self._listening:
                self._listening[viewer] = since_s


def _drop(viewers: dict[socket.socket, None]) -> None:
    """Close the connection of the first of some viewers. The thread that waits for that viewer then ends."""
    viewer = next(iter(viewers))
    del viewers[viewer]
    with suppress(OSError):
        viewer.shutdown(socket.SHUT_RDWR)


class _Asked(io.RawIOBase):
    """The request of a viewer, which has a time limit as a whole, however slowly its parts come."""

    def __init__(self, viewer: socket.socket, within_s: float) -> None:
        self._viewer: Final = viewer
        self._until_s: Final = time.monotonic() + within_s

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left_s = self._until_s - time.monotonic()
        if left_s <= 0.0:
            raise TimeoutError("it does not finish what it asks")
        self._viewer.settimeout(left_s)
        return self._viewer.recv_into(buffer)


class _Viewer(BaseHTTPRequestHandler):
    server: _Server
    timeout = VIEWER_S
    server_version = "SOTER"
    sys_version = ""

    def setup(self) -> None:
        super().setup()
        self.rfile = io.BufferedReader(_Asked(self.connection, self.timeout))

    def do_GET(self) -> None:
        # The viewer has as much time again to take the whole answer.
        self.connection.settimeout(self.timeout)
        if self.headers.get("Host") not in self.server.names:
            self._say(HTTPStatus.FORBIDDEN, b"This is no name of this server.\n", "text/plain")
            return
        address = urlsplit(self.path)
        if address.path == "/":
            page = self.server.screen.whole()
            status = HTTPStatus.SERVICE_UNAVAILABLE if page is None else HTTPStatus.OK
            self._say(status, _WAITING if page is None else page, "text/html; charset=utf-8")
        elif address.path == "/stream":
            self._stream(parse_qs(address.query))
        else:
            self._say(HTTPStatus.NOT_FOUND, b"There is nothing else here.\n", "text/plain")

    def log_message(self, *_: object) -> None:
        """Do nothing: requests of viewers are not logged."""

    def _say(self, status: HTTPStatus, body: bytes, kind: str) -> None:
        self._head(status, kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _head(self, status: HTTPStatus, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")

    def _stream(self, query: dict[str, list[str]]) -> None:
        """Send the news as server-sent events, until the run has ended or the viewer has left."""
        screen = self.server.screen
        after = self.headers.get("Last-Event-ID") or query.get("after", [""])[0]
        if self.headers.get("Sec-Fetch-Site", "same-origin") != "same-origin" or not _is_number(after):
            self._say(HTTPStatus.FORBIDDEN, b"Only the page of this server is told.\n", "text/plain")
            return
        if query.get("run") != [screen.token]:
            # A page of an earlier run on this port must not ask again.
            self._say(HTTPStatus.NO_CONTENT, b"", "text/event-stream")
            return
        self.server.listens(self.connection)
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES)
        self._head(HTTPStatus.OK, "text/event-stream")
        self.end_headers()
        try:
            self._tell(screen.events, int(after))
        except FellBehind:
            self.wfile.write(b"event: reload\ndata:\n\n")

    def _tell(self, events: EventBuffer, number: int) -> None:
        ended = False
        while not ended:
            parts, ended = events.after(number, ALIVE_S)
            self.server.tells(self.connection, time.monotonic())
            if not parts:
                self.wfile.write(b":\n\n")
            for part in parts:
                number += 1
                self.wfile.write(b"id: %d\ndata: %b\n\n" % (number, part))
            self.server.tells(self.connection, math.inf)
        # Else a viewer that has yet to look at all of it would ask again, and find no server.
        self.wfile.write(b"event: end\ndata:\n\n")


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 16

"""The live page: a small HTTP server on 127.0.0.1 for the page of a run that goes on, and for what is new of it.

It serves these two and nothing else, to whoever asks it by its own name: a page of somebody else's that a browser was
led here by would ask by another (DNS rebinding). Nothing that it is sent has any effect on the run.
"""

from __future__ import annotations

import secrets
import socket
import threading
import time
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import Any, BinaryIO, Final, NoReturn
from urllib.parse import parse_qs, urlsplit

from soter.live.process import serve
from soter.live.reel import FellBehind, Reel
from soter.live.view import HOST
from soter.record.content import Tick
from soter.record.follow import GrowingRecording
from soter.report.page.growing import GrowingPage

PUBLISH_S: Final = 0.25
"""Host time between two parts where there is always something new."""

VIEWER_S: Final = 3.0
"""Host time for which a viewer may not take what it is sent, or not finish what it asks; then it is dropped."""

ALIVE_S: Final = 2.0
"""Host time after which something is sent even if there is nothing to say: else a dead viewer would not be noticed."""

END_S: Final = 2.0
"""Host time that viewers have at the end to hear how the run ended."""

MOST_VIEWERS: Final = 64
SEND_BYTES: Final = 1 << 16
"""What the system may keep for a viewer that does not read. What is not sent yet is kept once for all of them."""

_WAITING: Final = b"""\
<!doctype html><meta charset="utf-8"><meta name="color-scheme" content="light dark">
<meta http-equiv="refresh" content="1"><title>SOTER</title><p>The run has not begun yet."""


class PageScreen:
    """Serves the page of a run. The thread that made it also shows; every viewer has a thread of its own.

    Args:
        port: of 127.0.0.1; 0 for one that is free.

    Raises:
        OSError: the port cannot be had.
    """

    def __init__(self, port: int) -> None:
        self.reel: Final = Reel()
        self.token: Final = secrets.token_urlsafe(9)
        self._lock: Final = threading.Lock()
        self._page: GrowingPage | None = None
        self._goes_on = True
        self._whole = (-1, b"")
        self._ticks: list[Tick] = []
        self._published_s = 0.0
        self._server: Final = _Server((HOST, port), self)
        threading.Thread(target=self._server.serve_forever, name="http", daemon=True).start()

    @property
    def port(self) -> int:
        return int(self._server.server_address[1])

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
        self.reel.end()
        until_s = time.monotonic() + END_S
        while self._server.streams and time.monotonic() < until_s:
            time.sleep(0.01)

    def whole(self) -> bytes | None:
        """Return the page of the run up to now; None before its first tick. Any thread may ask."""
        with self._lock:
            number = self.reel.count
            if self._page is None or not number:
                return None
            if self._whole[0] != number:
                stream = f"stream?run={self.token}&after={number}"
                self._whole = number, self._page.whole(stream, goes_on=self._goes_on).encode()
            return self._whole[1]

    def _publish(self) -> None:
        with self._lock:
            if self._page is not None:
                self.reel.add(self._page.add(self._ticks, goes_on=self._goes_on).encode())
        self._ticks.clear()
        self._published_s = time.monotonic()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    request_queue_size = MOST_VIEWERS

    def __init__(self, address: tuple[str, int], screen: PageScreen) -> None:
        self.screen: Final = screen
        self.streams = 0
        self._places: Final = threading.Semaphore(MOST_VIEWERS)
        self._counting: Final = threading.Lock()
        super().__init__(address, _Viewer)
        port = int(self.server_address[1])
        self.names: Final = {f"{HOST}:{port}", f"localhost:{port}"}

    def server_bind(self) -> None:
        """Bind, without asking anybody for the name of this host as the base class does."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = HOST, int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        if not self._places.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._places.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Drop a viewer that has left or does not read, without a word: it is no fault of the run's."""

    def count(self, by: int) -> None:
        """Note that a viewer has begun to listen, or has ended."""
        with self._counting:
            self.streams += by


class _Viewer(BaseHTTPRequestHandler):
    server: _Server
    timeout = VIEWER_S
    server_version = "SOTER"
    sys_version = ""

    def do_GET(self) -> None:
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
        """Say nothing: what viewers ask for is not worth a line."""

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
        """Tell what is new as server-sent events, until the run has ended or the viewer does not listen any more."""
        screen = self.server.screen
        after = self.headers.get("Last-Event-ID") or query.get("after", [""])[0]
        if self.headers.get("Sec-Fetch-Site", "same-origin") != "same-origin" or not _is_number(after):
            self._say(HTTPStatus.FORBIDDEN, b"Only the page of this server is told.\n", "text/plain")
            return
        if query.get("run") != [screen.token]:
            # A page of another run, which was here before: it is not to ask again.
            self._say(HTTPStatus.NO_CONTENT, b"", "text/event-stream")
            return
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES)
        self._head(HTTPStatus.OK, "text/event-stream")
        self.end_headers()
        self.server.count(1)
        try:
            self._tell(screen.reel, int(after))
        except FellBehind:
            self.wfile.write(b"event: reload\ndata:\n\n")
        finally:
            self.server.count(-1)

    def _tell(self, reel: Reel, number: int) -> None:
        ended = False
        while not ended:
            parts, ended = reel.after(number, ALIVE_S)
            if not parts:
                self.wfile.write(b":\n\n")
            for part in parts:
                number += 1
                self.wfile.write(b"id: %d\ndata: %b\n\n" % (number, part))


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 16


def main(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> NoReturn:
    """Be the process that `soter.live.view` starts."""
    serve(stdin, socket_fd, lifeline_fd, PageScreen)

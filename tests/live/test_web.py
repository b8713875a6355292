"""The server of the live page: what it serves and to whom, and that no viewer is in the way of another."""

from __future__ import annotations

import http.client
import math
import random
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import IO
from urllib.parse import quote

import pytest

from soter.live import web
from soter.live.web import PageScreen
from soter.record.follow import GrowingRecording
from tests.live.growing import Growing
from tests.report.unpacked import Unpacked, of_page
from tests.waiting import wait_until

SLOW_S = 0.3


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[PageScreen]:
    """A server of which nobody has said yet what is run, and which has little patience."""
    monkeypatch.setattr(web._Viewer, "timeout", SLOW_S)
    monkeypatch.setattr(web._Server, "serve_forever", lambda self: ThreadingHTTPServer.serve_forever(self, 0.01))
    screen = PageScreen(0)
    yield screen
    screen.close()
    screen._server.shutdown()
    screen._server.server_close()


def asked(screen: PageScreen, path: str, method: str = "GET", **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
    """An answer, with its body."""
    connection = http.client.HTTPConnection("127.0.0.1", screen.port, timeout=20.0)
    connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def stream_of(screen: PageScreen, after: int = 0) -> str:
    return f"/stream?run={screen.token}&after={after}"


@contextmanager
def listening(screen: PageScreen, after: int = 0, receive_bytes: int | None = None) -> Iterator[IO[bytes]]:
    """Somebody who listens to the stream, past the head of the answer."""
    with socket.socket() as link:
        if receive_bytes is not None:
            link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
        link.settimeout(20.0)
        link.connect(("127.0.0.1", screen.port))
        link.sendall(f"GET {stream_of(screen, after)} HTTP/1.1\r\nHost: 127.0.0.1:{screen.port}\r\n\r\n".encode())
        with link.makefile("rb") as lines:
            assert b"200" in lines.readline()
            while lines.readline().strip():
                pass
            yield lines


def next_part(lines: IO[bytes]) -> tuple[int, bytes]:
    """The number and the data of the next event."""
    line = lines.readline()
    while not line.startswith(b"id: "):
        assert line, "the stream has ended"
        line = lines.readline()
    return int(line[4:]), lines.readline().removeprefix(b"data: ").strip()


# --- what is served ----------------------------------------------------------------------------------------


def test_before_the_run_begins_the_page_says_so(screen: PageScreen) -> None:
    answer, body = asked(screen, "/")
    assert answer.status == 503
    assert b"as soon as it begins" in body
    assert b'http-equiv="refresh"' in body


def test_page_and_stream_show_a_recording_up_to_its_end(screen: PageScreen, whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    parts = [at / 20 for at in range(20, 0, -1)]
    pages: list[str] = []

    def wait() -> None:
        screen.pause()
        answer, body = asked(screen, "/")
        if answer.status == 200:
            pages.append(body.decode())
        growing.to(parts.pop())

    screen.show(GrowingRecording(growing.path, lambda: not parts, wait))
    screen.events.end()
    told = [of_page(page).document for page in pages]
    assert [each["goesOn"] for each in told] == [True] * len(told)
    assert 0.0 < told[0]["lastS"] < told[-1]["lastS"] < 60.0
    known = int(pages[0].partition("after=")[2].partition('"')[0])
    with listening(screen, known) as lines:
        rest = [next_part(lines) for _ in range(screen.events.count - known)]
    assert [number for number, _ in rest] == [*range(known + 1, screen.events.count + 1)]
    last = Unpacked(rest[-1][1].decode()).document
    assert (last["goesOn"], last["summary"]["status"], last["lastS"]) == (False, "completed", pytest.approx(59.95))


def test_the_answer_can_be_shown_nowhere_else_and_is_not_kept(screen: PageScreen) -> None:
    answer, _ = asked(screen, "/")
    assert answer.getheader("Cache-Control") == "no-store"
    assert answer.getheader("Content-Security-Policy") == "frame-ancestors 'none'"
    assert answer.getheader("Cross-Origin-Resource-Policy") == "same-origin"
    assert answer.getheader("Access-Control-Allow-Origin") is None


@pytest.mark.parametrize("path", ["/etc/passwd", "/../../etc/passwd", "/page", "/stream/x", "*"])
def test_there_is_nothing_else(screen: PageScreen, path: str) -> None:
    assert asked(screen, path)[0].status == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "HEAD"])
def test_it_can_only_be_looked_at(screen: PageScreen, method: str) -> None:
    assert asked(screen, "/", method)[0].status == 501


# --- to whom -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "[::1]:{port}", ""]
)
def test_who_asks_by_another_name_gets_nothing(screen: PageScreen, name: str) -> None:
    host = name.format(port=screen.port)
    for path in ("/", stream_of(screen)):
        assert asked(screen, path, Host=host)[0].status == 403


def test_it_has_two_names(screen: PageScreen) -> None:
    for name in ("127.0.0.1", "localhost"):
        assert asked(screen, "/", Host=f"{name}:{screen.port}")[0].status == 503


def test_it_listens_on_loopback_only(screen: PageScreen) -> None:
    assert screen._server.socket.getsockname()[0] == "127.0.0.1"


@pytest.mark.parametrize("site", ["cross-site", "same-site", "none"])
def test_pages_of_others_are_not_told_anything(screen: PageScreen, site: str) -> None:
    assert asked(screen, stream_of(screen), Sec_Fetch_Site=site)[0].status == 403


def test_a_page_of_an_earlier_run_is_told_not_to_ask_again(screen: PageScreen) -> None:
    assert asked(screen, "/stream?run=another&after=0")[0].status == 204


@pytest.mark.parametrize("after", ["", "x", "-1", "1" * 100, "٣"])
def test_a_number_that_is_none_is_refused(screen: PageScreen, after: str) -> None:
    assert asked(screen, f"/stream?run={screen.token}&after={quote(after)}")[0].status == 403


# --- viewers -----------------------------------------------------------------------------------------------


def test_a_viewer_goes_on_where_it_was(screen: PageScreen) -> None:
    for part in (b"one", b"two", b"three"):
        screen.events.add(part)
    screen.events.end()
    _, body = asked(screen, stream_of(screen), Last_Event_ID="2")
    assert body == b"id: 3\ndata: three\n\nevent: end\ndata:\n\n"


def test_who_is_too_far_behind_begins_anew(screen: PageScreen) -> None:
    for _ in range(3):
        screen.events.add(b"x" * (web.SEND_BYTES * 100))
    _, body = asked(screen, stream_of(screen, 0))
    assert body == b"event: reload\ndata:\n\n"


def test_a_viewer_that_never_reads_is_dropped_and_the_others_go_on(screen: PageScreen) -> None:
    with listening(screen) as good, listening(screen, receive_bytes=4096):
        wait_until(lambda: screen._server.streams == 2)
        number = 0
        while screen._server.streams == 2:
            screen.events.add(b"x" * 50_000)
            number += 1
            assert next_part(good)[0] == number
            assert number < 10_000
        assert screen._server.streams == 1
        screen.events.add(b"last")
        assert next_part(good) == (number + 1, b"last")


def test_a_viewer_that_has_left_is_noticed_although_there_is_nothing_new(
    screen: PageScreen, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web, "ALIVE_S", 0.05)
    with listening(screen):
        wait_until(lambda: screen._server.streams == 1)
    wait_until(lambda: screen._server.streams == 0)


def test_there_are_places_for_many_and_the_newest_takes_that_of_the_oldest(screen: PageScreen) -> None:
    with ExitStack() as stack:
        links = [stack.enter_context(listening(screen)) for _ in range(web.MOST_VIEWERS)]
        wait_until(lambda: screen._server.streams == web.MOST_VIEWERS)
        links.append(stack.enter_context(listening(screen)))
        wait_until(lambda: screen._server.streams == web.MOST_VIEWERS)
        assert links[0].read() == b"", "a browser whose stream ends asks again"
        assert asked(screen, "/")[0].status == 503
        screen.events.add(b"for all")
        assert {next_part(each) for each in links[1:]} == {(1, b"for all")}
        screen.events.end()
    wait_until(lambda: screen._server.streams == 0)
    wait_until(lambda: asked(screen, "/")[0].status == 503)


def test_garbage_is_answered_or_dropped_and_the_server_goes_on(screen: PageScreen) -> None:
    draw = random.Random("garbage")
    junk = [draw.randbytes(draw.randrange(1, 3000)) for _ in range(40)]
    junk += [
        b"",
        b"\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET " + b"/" * 100_000,
        b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 500,
    ]
    for each in junk:
        with socket.create_connection(("127.0.0.1", screen.port), timeout=20.0) as link, suppress(OSError):
            link.sendall(each)
            link.shutdown(socket.SHUT_WR)
            link.recv(1000)
    assert asked(screen, "/")[0].status == 503


def test_many_who_do_not_finish_asking_lock_nobody_out(screen: PageScreen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web._Viewer, "timeout", 60.0)
    with ExitStack() as stack:
        for _ in range(web.MOST_VIEWERS):
            link = stack.enter_context(socket.create_connection(("127.0.0.1", screen.port)))
            link.sendall(b"GET / HT")
        wait_until(lambda: len(screen._server._asking) == web.MOST_VIEWERS)
        began_s = time.monotonic()
        assert asked(screen, "/")[0].status == 503
        assert time.monotonic() - began_s < 1.0


def test_many_who_do_not_read_lock_nobody_out(screen: PageScreen, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web._Viewer, "timeout", 60.0)
    monkeypatch.setattr(web, "MOST_VIEWERS", 4)
    with ExitStack() as stack:
        for _ in range(4):
            stack.enter_context(listening(screen, receive_bytes=4096))
        wait_until(lambda: screen._server.streams == 4)
        for _ in range(20):
            screen.events.add(b"x" * 500_000)
        wait_until(lambda: all(since_s < math.inf for since_s in screen._server._listening.values()))
        screen.events.end()
        assert asked(screen, stream_of(screen, 19))[0].status == 200


def test_who_asks_without_end_is_dropped_in_time(screen: PageScreen) -> None:
    with socket.create_connection(("127.0.0.1", screen.port)) as link:
        link.settimeout(SLOW_S / 3)
        sent = 0
        with suppress(ConnectionError):
            while True:
                link.sendall(b"G")
                sent += 1
                with suppress(TimeoutError):
                    assert link.recv(1000) == b""
                    break
                assert sent < 100
    assert 1 < sent < 30


def test_who_does_not_finish_asking_is_dropped(screen: PageScreen) -> None:
    with socket.create_connection(("127.0.0.1", screen.port), timeout=20.0) as link:
        link.sendall(b"GET / HT")
        assert link.recv(1000) == b""

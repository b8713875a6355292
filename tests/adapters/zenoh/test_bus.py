"""The bus of a mission's processes: `soter.distribution.bus.Bus` over Zenoh."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from soter.adapters.zenoh.bus import ZenohBus
from soter.adapters.zenoh.session import SessionOptions
from soter.distribution.bus import Bus
from tests.adapters.zenoh.sessions import SILENCE_S, client, opened, router
from tests.waiting import PATIENCE_S, eventually


@pytest.fixture
def buses() -> Iterator[tuple[ZenohBus, ZenohBus]]:
    with router() as where:
        pair = ZenohBus.open(client(where)), ZenohBus.open(client(where))
        yield pair
        for bus in pair:
            bus.close()


def heard_by(bus: Bus, speaker: Bus, key: str = "soter/*/status") -> list[tuple[str, bytes]]:
    """What a bus hears, once it is known to hear the other."""
    heard: list[tuple[str, bytes]] = []
    bus.subscribe(key, lambda name, payload: heard.append((name, payload)))

    def said_and_heard() -> bool:
        speaker.publish("soter/beta/status", b"?")
        return bool(heard)

    assert eventually(said_and_heard)
    time.sleep(SILENCE_S)
    heard.clear()
    return heard


def test_a_burst_arrives_whole_and_in_order(buses: tuple[ZenohBus, ZenohBus]) -> None:
    alpha, beta = buses
    heard = heard_by(alpha, beta)
    said = [("soter/beta/status", b"%d" % number * 50) for number in range(50)]
    for key, payload in said:
        beta.publish(key, payload)
    beta.publish("soter/beta/other", b"under another key")
    assert eventually(lambda: len(heard) >= len(said))
    assert heard == said


def test_a_bus_does_not_hear_itself(buses: tuple[ZenohBus, ZenohBus]) -> None:
    alpha, beta = buses
    own: list[str] = []
    beta.subscribe("soter/*/status", lambda name, _: own.append(name))
    heard_by(alpha, beta)
    assert own == []


def test_what_fails_where_it_is_heard_is_counted_and_told_once(
    buses: tuple[ZenohBus, ZenohBus], caplog: pytest.LogCaptureFixture
) -> None:
    alpha, beta = buses
    heard = heard_by(alpha, beta)

    def fail(_name: str, payload: bytes) -> None:
        raise KeyError(payload)

    alpha.subscribe("soter/*/status", fail)
    for _ in range(3):
        beta.publish("soter/beta/status", b"x")
    assert eventually(lambda: alpha.failed >= 3 and len(heard) >= 3)
    told = [each for each in caplog.records if each.levelno == logging.ERROR]
    assert len(told) == 1
    assert told[0].getMessage().startswith("soter/*/status: ")
    assert told[0].exc_info is not None


def test_publishing_never_raises(buses: tuple[ZenohBus, ZenohBus], caplog: pytest.LogCaptureFixture) -> None:
    alpha, _ = buses
    for _ in range(2):
        alpha.publish("/no/key/", b"")
    assert alpha.lost == 2
    assert [each.levelname for each in caplog.records] == ["WARNING"]
    alpha.close()
    alpha.close()
    alpha.publish("soter/alpha/status", b"")
    assert alpha.lost == 3
    assert len(caplog.records) == 1


def test_what_is_no_key_cannot_be_heard(buses: tuple[ZenohBus, ZenohBus]) -> None:
    with pytest.raises(ValueError, match="'soter//status' is no key to subscribe to"):
        buses[0].subscribe("soter//status", lambda *_: None)


def test_nothing_is_heard_after_leaving(buses: tuple[ZenohBus, ZenohBus]) -> None:
    alpha, beta = buses
    heard = heard_by(alpha, beta)
    alpha.close()
    beta.publish("soter/beta/status", b"too late")
    time.sleep(SILENCE_S)
    assert heard == []


LEFT_OPEN = """
import sys
from soter.adapters.zenoh.bus import ZenohBus
from soter.adapters.zenoh.session import SessionOptions
heard = []
bus = ZenohBus.open(SessionOptions(mode="client", connect=(sys.argv[1],)))
bus.subscribe("soter/*/status", lambda *message: heard.append(message))
while not heard:
    pass
"""


def test_a_program_that_forgets_to_leave_can_end() -> None:
    with (
        router() as where,
        opened(client(where)) as (beta,),
        subprocess.Popen([sys.executable, "-c", LEFT_OPEN, *where]) as process,
    ):
        until_s = time.monotonic() + PATIENCE_S
        while process.poll() is None and time.monotonic() < until_s:
            beta.put("soter/beta/status", bytes(100))
            time.sleep(1e-4)
        process.kill()
    assert process.returncode == 0


FROZEN_ROUTER = """
import sys, zenoh
from soter.adapters.zenoh.session import SessionOptions, endpoints, open_session
session = open_session(SessionOptions(mode="router", listen=("tcp/127.0.0.1:0",)))
subscriber = session.declare_subscriber("soter/**", zenoh.handlers.RingChannel(1))
print(*endpoints(session), flush=True)
sys.stdin.read()
"""


def test_publishing_does_not_wait_for_somebody_who_does_not_read() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", FROZEN_ROUTER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            bus = ZenohBus.open(SessionOptions(mode="client", connect=(process.stdout.readline().strip(),)))
            os.kill(process.pid, signal.SIGSTOP)
            took_s = []
            for _ in range(3000):  # far more than sockets hold
                begun_s = time.thread_time()
                bus.publish("soter/alpha/status", bytes(10_000))
                took_s.append(time.thread_time() - begun_s)
            begun_s = time.monotonic()
            for _ in range(100):
                bus.publish("soter/alpha/status", bytes(10_000))
            full_s = time.monotonic() - begun_s
            begun_s = time.monotonic()
            bus.close()
            closed_s = time.monotonic() - begun_s
        finally:
            process.kill()
    assert full_s < 0.2
    assert max(took_s) < 0.1
    assert closed_s < 3.0

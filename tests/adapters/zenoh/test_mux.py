"""The mux as a program: what it passes, what it says, how it ends, and what it says of bad options."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh

from soter.adapters.zenoh.messages import String, Twist, Vector3
from soter.adapters.zenoh.session import SessionOptions, endpoints
from soter.adapters.zenoh.talk import Ear, Presence, Voice
from soter.onboard.wire import AC, SC, GateReport, Order
from tests.adapters.zenoh.sessions import opened
from tests.waiting import eventually


class Bench:
    """A mux on its own, with a clock of its host, and everybody that it talks to in one session."""

    def __init__(self, session: zenoh.Session, where: list[str], *options: str) -> None:
        self.passed: list[float] = []
        self.reports: list[GateReport] = []
        self.presence = Presence(session, "robot1")
        Ear(session, "robot1/base", Twist, lambda message: self.passed.append(message.linear.x))
        Ear(session, "robot1/soter/gate", String, lambda message: self.reports.append(GateReport.decode(message.data)))
        self._orders = Voice(session, "robot1/soter/order")
        self._asked = {AC: Voice(session, "robot1/cmd_vel_ac"), SC: Voice(session, "robot1/cmd_vel_sc")}
        self._seq = 0
        arguments = ["--robot", "robot1", "--key", "cmd_vel=base", *options]
        for each in where:
            arguments += ["--connect", each]
        self.process = subprocess.Popen([sys.executable, "-m", "soter.adapters.zenoh.mux", *arguments])

    def order(self, controller: str, renewed_s: float | None, session: str = "me") -> None:
        self._seq += 1
        self._orders.say(String(Order(session, self._seq, controller, renewed_s).encode()))

    def ask(self, by: str, speed_m_s: float) -> None:
        self._asked[by].say(Twist(Vector3(x=speed_m_s)))

    def passes(self, expected_m_s: float, *, by: str, speed_m_s: float, in_charge: str) -> bool:
        """Whether this is what passes in the end, with the lease renewed again and again."""

        def passed() -> bool:
            self.order(in_charge, time.time())
            self.ask(by, speed_m_s)
            return bool(self.passed) and self.passed[-1] == expected_m_s

        return eventually(passed)


@pytest.fixture
def start() -> Iterator[Callable[..., Bench]]:
    benches: list[Bench] = []
    with opened(SessionOptions()) as (session,):

        def start(*options: str) -> Bench:
            benches.append(Bench(session, endpoints(session), *options))
            assert eventually(lambda: bool(benches[-1].passed) and bool(benches[-1].reports))
            return benches[-1]

        yield start
        for each in benches:
            each.process.kill()
            each.process.wait()


def test_it_lets_one_of_two_drive_within_the_limits_for_as_long_as_the_lease_lives(start: Callable[..., Bench]) -> None:
    mux = start("--v-max", "0.2")
    assert mux.presence.there == {"mux"}
    assert mux.reports[-1] == GateReport("", 0, SC, alive=False)
    # It says what it does before anybody has asked, again and again: whoever comes later has heard nothing before.
    told = len(mux.reports)
    assert eventually(lambda: len(mux.reports) > told + 1)
    assert mux.passes(0.1, by=SC, speed_m_s=0.1, in_charge=SC)
    assert mux.passes(0.0, by=AC, speed_m_s=0.1, in_charge=SC)
    assert mux.passes(0.2, by=AC, speed_m_s=5.0, in_charge=AC)
    assert mux.passes(0.0, by=AC, speed_m_s=math.nan, in_charge=AC)
    assert mux.passes(-0.2, by=AC, speed_m_s=-5.0, in_charge=AC)
    report = mux.reports[-1]
    assert (report.session, report.controller, report.alive) == ("me", AC, True)
    # The lease dies, however much is asked for.
    for _ in range(20):
        mux.ask(AC, 0.1)
        time.sleep(0.02)
    assert eventually(lambda: mux.passed[-1] == 0.0)
    assert eventually(lambda: not mux.reports[-1].alive)
    # A renewal that waited for a minute renews nothing.
    mux.order(AC, time.time() - 60.0)
    mux.ask(AC, 0.1)
    time.sleep(0.1)
    assert mux.passed[-1] == 0.0


def test_a_flood_in_one_name_does_not_hold_up_a_change_of_hands(start: Callable[..., Bench]) -> None:
    mux = start()
    over = threading.Event()

    def flood() -> None:
        while not over.is_set():
            mux.ask(AC, 0.1)

    flooding = threading.Thread(target=flood)
    assert mux.passes(0.1, by=AC, speed_m_s=0.1, in_charge=AC)
    flooding.start()
    try:
        for _ in range(5):
            for controller in (SC, AC):
                mux.order(controller, time.time())
                began_s = time.monotonic()
                assert eventually(lambda controller=controller: mux.reports[-1].controller == controller)  # type: ignore[misc]
                # What is promised of a hand-over, and what a busy host adds.
                assert time.monotonic() - began_s < 0.3
    finally:
        over.set()
        flooding.join()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_when_it_is_told_to_end_it_says_rest_last(start: Callable[..., Bench], number: int) -> None:
    mux = start()
    assert mux.passes(0.1, by=SC, speed_m_s=0.1, in_charge=SC)
    mux.process.send_signal(number)
    assert mux.process.wait(10.0) == 0
    assert eventually(lambda: mux.passed[-1] == 0.0)
    assert eventually(lambda: mux.presence.there == set())


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--robot", "/robot1"], "--robot is '/robot1', allowed: a key such as robot1/odom"),
        (["--robot", "r", "--lease", "0"], "argument --lease: it is 0, allowed: finite and above 0"),
        (["--robot", "r", "--v-max", "nan"], "argument --v-max: it is nan, allowed: finite and above 0"),
        (["--robot", "r", "--command", "soon"], "argument --command: it is soon, allowed"),
        (["--robot", "r", "--speedup", "0"], "argument --speedup: it is 0, allowed: finite and above 0"),
        (["--robot", "r", "--key", "odm=x"], "--key.odm: unknown key, did you mean 'odom'?"),
        (["--robot", "r", "--key", "odom"], "--key.odom: it is '', allowed: a key"),
        (["--robot", "r", "--mode", "client"], "session.connect: it is (), allowed: at least one with mode = 'client'"),
        (["--robot", "r", "--session", "/no/such.toml"], "/no/such.toml"),
    ],
)
def test_bad_options_end_it_before_anything_moves(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.adapters.zenoh.mux import main

    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert complaint in capsys.readouterr().err


@pytest.mark.usefixtures("own_signals")
def test_what_is_in_a_file_about_the_session_counts(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    from soter.adapters.zenoh.mux import main

    file = tmp_path / "session.toml"
    for text, complaint in (
        ('mode = "router', "session.toml: it cannot be read"),
        ('listn = ["tcp/127.0.0.1:0"]', "did you mean 'listen'?"),
        ('mode = "client"\nconnect = ["tcp/127.0.0.1:9"]\nopen_timeout_s = 0.2', "no Zenoh router is reached within"),
        ('connect = ["tcp/10.0.0.7:7447"]', "or unencrypted = true where the network itself is closed"),
    ):
        file.write_text(text)
        with pytest.raises(SystemExit):
            main(["--robot", "r", "--session", str(file)])
        assert complaint in capsys.readouterr().err

"""Hearing and saying: nothing that is wrong gets lost, and nothing waits."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest
import zenoh

from soter.adapters.zenoh.messages import String, Twist, Vector3, encode
from soter.adapters.zenoh.session import SessionOptions, close_session
from soter.adapters.zenoh.talk import Ear, Presence, Voice, announce
from soter.errors import RobotUnavailable
from tests.adapters.zenoh.sessions import SILENCE_S, opened
from tests.waiting import eventually


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    with opened(SessionOptions()) as (session,):
        yield session


def test_what_is_said_is_heard(session: zenoh.Session) -> None:
    heard: list[Twist] = []
    Ear(session, "a/b", Twist, heard.append)
    Voice(session, "a/b").say(Twist(Vector3(x=0.2)))
    assert eventually(lambda: heard == [Twist(Vector3(x=0.2))])


def test_what_is_foreign_is_counted_and_said_once(session: zenoh.Session, caplog: pytest.LogCaptureFixture) -> None:
    heard: list[Twist] = []
    ear = Ear(session, "a/b", Twist, heard.append)
    for _ in range(3):
        seen = ear.foreign
        session.put("a/b", encode(String("no velocity")))
        assert eventually(lambda seen=seen: ear.foreign > seen)  # type: ignore[misc]
    session.put("a/b", encode(Twist()))
    assert eventually(lambda: heard == [Twist()])
    assert (ear.heard, ear.foreign, ear.failed) == (1, 3, 0)
    assert [each.getMessage().partition(":")[0] for each in caplog.records] == ["a/b"]
    assert "dropped what is no Twist" in caplog.text


def test_what_fails_while_it_is_taken_is_not_swallowed(
    session: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    def take(message: String) -> None:
        raise RuntimeError(message.data)

    ear = Ear(session, "a/b", String, take)
    for text in ("one", "two"):
        seen = ear.failed
        session.put("a/b", encode(String(text)))
        assert eventually(lambda seen=seen: ear.failed > seen)  # type: ignore[misc]
    assert ear.heard == 2
    (record,) = caplog.records
    assert record.levelno == logging.ERROR
    assert record.exc_info is not None
    assert str(record.exc_info[1]) == "one"


def test_who_is_slow_hears_the_newest(session: zenoh.Session) -> None:
    heard: list[str] = []
    goes_on = threading.Event()

    def take(message: String) -> None:
        heard.append(message.data)
        goes_on.wait(10.0)

    Ear(session, "a/b", String, take)
    voice = Voice(session, "a/b")
    voice.say(String("first"))
    assert eventually(lambda: heard == ["first"])
    for number in range(100):
        voice.say(String(str(number)))
    goes_on.set()
    assert eventually(lambda: heard[-1] == "99")
    assert len(heard) <= 3


def test_what_was_taken_away_is_no_message(session: zenoh.Session) -> None:
    ear = Ear(session, "a/b", String, lambda _: None)
    session.delete("a/b")
    session.put("a/b", encode(String("after")))
    assert eventually(lambda: ear.heard == 1)
    assert (ear.foreign, ear.failed) == (0, 0)


def test_one_can_leave_out_what_one_says_oneself(session: zenoh.Session) -> None:
    ear = Ear(session, "a/b", String, lambda _: None, elsewhere_only=True)
    Voice(session, "a/b").say(String("own"))
    time.sleep(SILENCE_S)
    assert ear.heard == 0


def test_after_its_end_an_ear_hears_nothing_and_ends_its_thread(session: zenoh.Session) -> None:
    before = {*threading.enumerate()}
    ear = Ear(session, "a/b", String, lambda _: None)
    ear.close()
    ear.close()
    Voice(session, "a/b").say(String("late"))
    assert {*threading.enumerate()} <= before
    assert ear.heard == 0


def test_over_a_session_that_is_closed_nothing_is_said(session: zenoh.Session) -> None:
    voice, ear = Voice(session, "a/b"), Ear(session, "a/b", String, lambda _: None)
    close_session(session)
    with pytest.raises(RobotUnavailable, match="a/b: nothing can be sent any more"):
        voice.say(String("late"))
    ear.close()


def test_who_is_there_and_who_has_gone(session: zenoh.Session, caplog: pytest.LogCaptureFixture) -> None:
    token = announce(session, "robot1", "mux")
    announce(session, "robot2", "mux")
    presence = Presence(session, "robot1")
    assert eventually(lambda: presence.there == {"mux"})
    token.undeclare()  # type: ignore[no-untyped-call] # its stub has no return type
    assert eventually(lambda: presence.there == set())
    assert "robot1: its mux has gone, or the link to it" in caplog.text


def test_a_program_that_ends_while_it_listens_ends_well() -> None:
    program = (
        "from soter.adapters.zenoh.messages import String\n"
        "from soter.adapters.zenoh.session import SessionOptions, open_session\n"
        "from soter.adapters.zenoh.talk import Ear, Voice\n"
        "session = open_session(SessionOptions())\n"
        "ears = [Ear(session, f'a/{i}', String, lambda _: None) for i in range(8)]\n"
        "for i in range(8): Voice(session, f'a/{i}').say(String('x'))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")

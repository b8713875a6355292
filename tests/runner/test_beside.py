"""What happens beside the ticks: showing progress, passing on what a mission prints, scheduling."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Iterator

import pytest

from soter.errors import ConfigError
from soter.runner import Progress
from soter.runner.progress import ProgressThread
from soter.runner.real_time import real_time
from soter.runner.remote_host import OutputPump
from tests.waiting import wait_until


def progress(time_s: float) -> Progress:
    return Progress(time_s, 60.0, time_s, (), None)


def test_only_the_latest_progress_is_shown_and_nobody_waits_for_it() -> None:
    shown: list[float] = []
    first, go_on = threading.Event(), threading.Event()

    def show(each: Progress) -> None:
        shown.append(each.time_s)
        first.set()
        assert go_on.wait(10.0)

    with ProgressThread(show) as aside:
        aside.put(progress(1.0))
        assert first.wait(10.0)
        for time_s in (2.0, 3.0, 4.0):
            aside.put(progress(time_s))
        go_on.set()
        wait_until(lambda: len(shown) == 2)
    assert shown == [1.0, 4.0]


def test_a_display_that_fails_is_left_alone(caplog: pytest.LogCaptureFixture) -> None:
    shown: list[Progress] = []

    def show(each: Progress) -> None:
        shown.append(each)
        raise OSError("the terminal is gone")

    with ProgressThread(show) as aside:
        aside.put(progress(1.0))
        wait_until(lambda: bool(shown))
        aside.put(progress(2.0))
    assert len(shown) == 1
    assert "cannot be shown" in caplog.text


@pytest.fixture
def words() -> Iterator[tuple[OutputPump, int]]:
    made = OutputPump("mission")
    speaker = os.dup(made.output_fd)
    made.started()
    yield made, speaker
    made.close()


def test_what_is_printed_is_logged(words: tuple[OutputPump, int], caplog: pytest.LogCaptureFixture) -> None:
    made, speaker = words
    os.write(speaker, b"hello\n\n\x1b[2Jworld \xff\n")
    os.close(speaker)
    made.close()
    assert [record.getMessage() for record in caplog.records] == ["mission: hello", "mission:  [2Jworld \ufffd"]


def test_a_line_that_comes_in_pieces_is_one(
    words: tuple[OutputPump, int], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("soter.runner.remote_host._PAUSE_S", 0.0)
    made, speaker = words
    for piece in (b"hel", b"lo w\xc3", b"\xb6rld\nand", b" no end"):
        os.write(speaker, piece)
        time.sleep(0.02)
    os.close(speaker)
    made.close()
    assert [record.getMessage() for record in caplog.records] == ["mission: hello w\xf6rld", "mission: and no end"]


def test_a_flood_is_logged_in_part(words: tuple[OutputPump, int], caplog: pytest.LogCaptureFixture) -> None:
    made, speaker = words
    os.write(speaker, b"x" * 1000 + b"\n" + b"y\n" * 1000)
    os.close(speaker)
    made.close()
    said = [record.getMessage() for record in caplog.records]
    assert len(said) == 21
    assert len(said[0]) < 320
    assert said[-1] == "mission: ... and 981 lines more"


def test_a_process_left_behind_is_not_waited_for(words: tuple[OutputPump, int]) -> None:
    made, speaker = words
    began_s = time.perf_counter()
    made.close()
    assert time.perf_counter() - began_s < 5.0
    os.close(speaker)


def test_every_thread_is_scheduled_in_real_time_and_as_before_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    policies: dict[int, list[int]] = {}

    def note(task: int, policy: int, parameters: os.sched_param) -> None:
        policies.setdefault(task, []).append(policy)

    monkeypatch.setattr("os.sched_setscheduler", note)
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    with real_time(required=True) as so:
        assert so
    done.set()
    thread.join()
    for task in (os.getpid(), thread.native_id):
        assert task is not None
        assert policies[task] == [os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.SCHED_OTHER]


def test_where_it_is_not_allowed_all_goes_on_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr("os.sched_setscheduler", refuse)
    with real_time(required=False) as so:
        assert not so
    with pytest.raises(ConfigError, match="CAP_SYS_NICE"), real_time(required=True):
        pass


@pytest.fixture(autouse=True)
def _heard(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

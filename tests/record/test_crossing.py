"""What crosses from a run to its writer, and when: nothing is held back for long, and nothing of it is lost."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from soter.record import pipe as pipes
from soter.record import recorder as recorders
from soter.record.attachments import Result
from soter.record.messages import TransitionEvent
from soter.record.pipe import WriterPipe
from soter.record.reader import Recording
from soter.record.recorder import TOGETHER, TOGETHER_NS, Recorder
from soter.record.wire import FrameReader, Ticks
from soter.rta import Supervisor
from soter.runner import Run, run_mission
from soter.runner.trace import Trace
from tests.record.helpers import mission
from tests.waiting import wait_until

MS = 1_000_000
TICKS = 100
DURATION_S = TICKS * 0.05


class HostClock:
    """The host's time of day, which goes on only when it is told to."""

    def __init__(self) -> None:
        self.now_ns = 1_700_000_000 * 1000 * MS

    def time_ns(self) -> int:
        return self.now_ns


class Crossing(NamedTuple):
    """A frame of ticks.

    Attributes:
        at_ns: when it crossed.
        ticks: the numbers of its ticks.
        made_ns: when each of them was.
    """

    at_ns: int
    ticks: list[int]
    made_ns: list[int]

    @property
    def held_ns(self) -> int:
        return self.at_ns - self.made_ns[0]


def crossings(
    monkeypatch: pytest.MonkeyPatch, path: Path, took_ns: Callable[[int], int], *, waits: bool = True
) -> list[Crossing]:
    """Record a run of `TICKS` ticks, of which each takes so much host time; return what crossed."""
    clock, seen, intake = HostClock(), [], FrameReader()

    class Seen(WriterPipe):
        def send(self, frame: bytes) -> bool:
            for each in intake.take(frame):
                if isinstance(each, Ticks):
                    made_ns = [tick.host_ns for tick in each.ticks]
                    seen.append(Crossing(clock.now_ns, [tick.tick for tick in each.ticks], made_ns))
            return super().send(frame)

    class Paced(Recorder):
        def __init__(self, path: Path, *, waits: bool, **named: Any) -> None:
            super().__init__(path, waits=waits and in_virtual_time, **named)

        def tick(self, now_s: float, tick: int) -> None:
            clock.now_ns += took_ns(tick)
            super().tick(now_s, tick)

    in_virtual_time = waits
    monkeypatch.setattr(recorders, "time", clock)
    monkeypatch.setattr(recorders, "WriterPipe", Seen)
    monkeypatch.setattr("soter.runner.run.Recorder", Paced)
    run_mission(mission(duration_s=DURATION_S), record=path)
    assert numbers(path) == list(range(TICKS))
    return seen


def numbers(path: Path) -> list[int]:
    """The ticks of a recording that was closed."""
    recording = Recording(path)
    found = [tick.tick for tick in recording.ticks() if tick.robots]
    assert not recording.truncated
    return found


# --- how long a tick is held back --------------------------------------------------------------------------


def test_fast_ticks_of_virtual_time_cross_together(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen = crossings(monkeypatch, tmp_path / "run.mcap", lambda _: MS // 10)
    assert [len(each.ticks) for each in seen] == [1, *[TOGETHER] * 12, 3]


@pytest.mark.parametrize("took_ms", [2.5, 3, 7, 9.9, 10, 15, 21, 500])
def test_no_tick_is_held_back_for_long(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, took_ms: float) -> None:
    seen = crossings(monkeypatch, tmp_path / "run.mcap", lambda _: int(took_ms * MS))
    assert max(each.held_ns for each in seen) < TOGETHER_NS
    if took_ms >= TOGETHER_NS / MS:
        assert [each.ticks for each in seen] == [[tick] for tick in range(TICKS)]


def test_ticks_that_become_slow_cross_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    slow = 43
    seen = crossings(monkeypatch, tmp_path / "run.mcap", lambda tick: MS // 10 if tick < slow else 100 * MS)
    assert [each.ticks for each in seen if each.ticks[-1] > slow] == [[tick] for tick in range(slow + 1, TICKS)]


@pytest.mark.parametrize("took_ms", [0, 1, 50])
def test_on_a_wall_clock_every_tick_crosses_at_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, took_ms: int
) -> None:
    seen = crossings(monkeypatch, tmp_path / "run.mcap", lambda _: took_ms * MS, waits=False)
    assert [each.ticks for each in seen] == [[tick] for tick in range(TICKS)]
    assert [each.held_ns for each in seen] == [0] * TICKS


# --- however the run ends ----------------------------------------------------------------------------------


class Broken(RuntimeError):
    """What nobody expects."""


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ticks for which the host's clock stands still: of any eight of them seven are held back."""
    monkeypatch.setattr(recorders, "time", HostClock())


@pytest.mark.usefixtures("held")
@pytest.mark.parametrize("ticks", range(1, 2 * TOGETHER + 2))
def test_an_ordinary_end_loses_nothing(tmp_path: Path, ticks: int) -> None:
    run = run_mission(mission(duration_s=ticks * 0.05), record=tmp_path / "run.mcap")
    assert run.result.status == "completed"
    assert numbers(tmp_path / "run.mcap") == list(range(ticks))
    assert (Recording(tmp_path / "run.mcap").result or Result("")).status == "completed"


@pytest.mark.usefixtures("held")
@pytest.mark.parametrize("failure", [Broken, KeyboardInterrupt])
@pytest.mark.parametrize("tick", [0, 1, 5, 8, 9, 15, 16, 50])
def test_a_run_that_raises_within_a_tick_loses_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, tick: int, failure: type[BaseException]
) -> None:
    def broken(_: Trace, now_s: float, robots: object) -> None:
        if round(now_s / 0.05) == tick:
            raise failure

    monkeypatch.setattr(Trace, "add", broken)
    path = tmp_path / "run.mcap"
    if failure is Broken:
        with pytest.raises(Broken):
            run_mission(mission(duration_s=DURATION_S), record=path)
        assert Recording(path).result is None
    else:
        assert run_mission(mission(duration_s=DURATION_S), record=path).result.status == "interrupted"
        assert (Recording(path).result or Result("")).status == "interrupted"
    assert numbers(path) == list(range(tick))


def test_what_happened_in_a_tick_that_raised_is_recorded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    whole, part = tmp_path / "whole.mcap", tmp_path / "part.mcap"
    run_mission(mission(duration_s=120.0, targets="hostile"), record=whole)
    first = Recording(whole).content().switches[0]
    tick_on = Supervisor.tick

    def broken(supervisor: Supervisor, now_s: float) -> None:
        tick_on(supervisor, now_s)
        if now_s >= first.time_s:
            raise Broken

    monkeypatch.setattr(Supervisor, "tick", broken)
    with pytest.raises(Broken):
        run_mission(mission(duration_s=120.0, targets="hostile"), record=part)
    content = Recording(part).content()
    assert content.switches[:1] == [first]
    assert content.last_s < first.time_s


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("held", "own_signals")
def test_an_interrupt_while_the_run_waits_for_its_writer_loses_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Whoever runs a mission from a program of his own has no handler that waits until a tick is over."""
    path = tmp_path / "run.mcap"
    stopped = threading.Event()
    done, pids = [0], [0]

    class Stopping(Recorder):
        def tick(self, now_s: float, tick: int) -> None:
            if tick == TICKS:
                assert self.writer_pid is not None
                pids[0] = self.writer_pid
                os.kill(pids[0], signal.SIGSTOP)
                stopped.set()
            super().tick(now_s, tick)
            done[0] = tick + 1

    def interrupt() -> None:
        stopped.wait(60.0)
        before = -1
        while before != done[0]:
            before = done[0]
            time.sleep(0.5)
        signal.pthread_kill(main, signal.SIGINT)
        try:
            # By then it has left the write, or never will.
            wait_until(left.is_set)
        finally:
            os.kill(pids[0], signal.SIGCONT)

    left = threading.Event()
    finish = Recorder.finish

    def finished(recorder: Recorder, result_json: bytes) -> None:
        left.set()
        finish(recorder, result_json)

    # Frames of more than a page, which a pipe takes in parts.
    monkeypatch.setattr(recorders, "TOGETHER", 64)
    monkeypatch.setattr("soter.runner.run.Recorder", Stopping)
    monkeypatch.setattr(Recorder, "finish", finished)
    # Whoever starts the tests in the background has Ctrl-C ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    main = threading.get_ident()
    helper = threading.Thread(target=interrupt)
    helper.start()
    run: Run = run_mission(mission(duration_s=1e6), record=path)
    helper.join()
    assert run.result.status == "interrupted"
    assert run.recording is not None
    assert run.recording.failure == ""
    # The tick that was interrupted is recorded, too, if it had come to be.
    assert numbers(path) in (list(range(done[0])), list(range(done[0] + 1)))


# --- the end of the pipe -----------------------------------------------------------------------------------


def test_ticks_that_were_dropped_at_the_very_end_are_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"

    class Dropping(WriterPipe):
        sent = 0

        def send(self, frame: bytes) -> bool:
            self.sent += 1
            return not 91 < self.sent <= 101 and super().send(frame)

    class Unwaiting(Recorder):
        def __init__(self, path: Path, *, waits: bool, **named: Any) -> None:
            super().__init__(path, waits=False, **named)

    monkeypatch.setattr(recorders, "WriterPipe", Dropping)
    monkeypatch.setattr("soter.runner.run.Recorder", Unwaiting)
    run = run_mission(mission(duration_s=DURATION_S), record=path)
    assert run.recording is not None
    assert run.recording.dropped_ticks == 10
    (drop,) = Recording(path).content().drops
    assert (drop.first_tick, drop.ticks) == (90, 10)
    assert numbers(path) == list(range(90))


def test_a_writer_that_does_not_take_the_end_in_time_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # It has only been started, and more than the pipe holds is to be taken at once.
    pipe = WriterPipe(tmp_path / "run.mcap", waits=False)
    with monkeypatch.context() as at_once:
        at_once.setattr(pipes, "CLOSE_S", 0.0)
        outcome = pipe.close(bytes(2 * pipes.CAPACITY_BYTES))
    assert "did not take" in outcome.failure
    assert pipe.close(b"") == outcome


def test_a_frame_that_is_too_large_costs_the_recording_only(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(pipes, "HELD_BYTES", 5000)
    run = run_mission(mission(duration_s=DURATION_S), record=tmp_path / "run.mcap")
    assert run.result.status == "completed"
    assert run.recording is not None
    assert "too large" in run.recording.failure


def test_changes_at_impossible_times_are_left_out_and_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Lied(Recorder):
        def tick(self, now_s: float, tick: int) -> None:
            for time_s in (1e300, -1e9, float("nan"), 10**400, now_s + 61.0, now_s):
                self.on_transition(TransitionEvent(time_s, "Liar", 1, "local"))
            super().tick(now_s, tick)

    monkeypatch.setattr("soter.runner.run.Recorder", Lied)
    path = tmp_path / "run.mcap"
    done = run_mission(mission(duration_s=1.0), record=path)
    assert done.recording is not None
    assert (done.recording.failure, done.recording.refused) == ("", 5 * 20)
    said = [
        each for _, each in Recording(path).messages() if isinstance(each, TransitionEvent) and each.machine == "Liar"
    ]
    assert [each.time_s for each in said] == pytest.approx([tick * 0.05 for tick in range(20)])

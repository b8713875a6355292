"""Whatever happens to a run, to its writer or to the disk: what was recorded can be read, and the run goes on."""

from __future__ import annotations

import logging
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from soter.record.content import RecordedTick
from soter.record.digest import DigestState, prove
from soter.record.reader import BadRecording, Recording
from soter.record.recorder import Recorder
from soter.runner import Follower, run_mission
from tests.project.source import ROOT
from tests.record.helpers import (
    SURVEILLANCE,
    mission,
    processor_wait_s,
    recorded,
    started,
    writer_of,
)
from tests.waiting import gone, wait_until

FOR_EVER = ("--backend", "kinematic", "--planner", "straight-line", "--duration", "1e6")
MOMENTS_S = [random.Random(f"moment {number}").uniform(0.05, 1.5) for number in range(6)]
LATEST_S = 1.0


def ticks_of(path: Path) -> list[RecordedTick]:
    ticks = [tick for tick in Recording(path).ticks() if tick.robots]
    assert [tick.tick for tick in ticks] == list(range(len(ticks)))
    return ticks


@pytest.mark.parametrize("moment_s", MOMENTS_S)
def test_everything_up_to_the_last_second_survives_a_kill(tmp_path: Path, moment_s: float) -> None:
    path = tmp_path / "run.mcap"
    with started(path, *FOR_EVER) as process:
        writer = writer_of(process.pid)
        waited_s = -processor_wait_s(writer, process.pid)
        time.sleep(moment_s)
        waited_s += processor_wait_s(writer, process.pid)
        killed_ns = time.time_ns()
        # The hardest case: nobody is left to write what is in the pipe.
        os.kill(writer, signal.SIGKILL)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    recording = Recording(path)
    assert recording.truncated
    assert recording.result is None
    ticks = ticks_of(path)
    last_ns = ticks[-1].host_ns if ticks else killed_ns - int(moment_s * 1e9)
    # Time for which a busy machine let the two processes wait is not theirs.
    assert (killed_ns - last_ns) / 1e9 <= LATEST_S + waited_s


def test_a_killed_run_leaves_a_closed_file_that_holds_its_last_tick(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with started(path, *FOR_EVER) as process:
        writer = writer_of(process.pid)
        waited_s = -processor_wait_s(writer, process.pid)
        time.sleep(0.5)
        waited_s += processor_wait_s(writer, process.pid)
        killed_ns = time.time_ns()
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        wait_until(lambda: gone(writer))
    recording = Recording(path)
    assert not recording.truncated
    assert recording.result is None
    assert (killed_ns - ticks_of(path)[-1].host_ns) / 1e9 <= 0.2 + waited_s


KILLED_AT_ITS_BEGINNING = """
import os, sys
from pathlib import Path
from soter.record.pipe import WriterPipe
from soter.runner import run_mission
from tests.record.helpers import mission

WriterPipe.wait_ready = lambda pipe: (print(pipe.pid, flush=True), os._exit(9))
run_mission(mission(duration_s=1.0), record=Path(sys.argv[1]))
"""


def test_a_run_that_is_killed_before_its_writer_is_ready_leaves_a_closed_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    done = subprocess.run(
        [sys.executable, "-c", KILLED_AT_ITS_BEGINNING, path], cwd=ROOT, capture_output=True, text=True, check=False
    )
    wait_until(lambda: gone(int(done.stdout)))
    assert done.returncode == 9
    assert prove(path).state is DigestState.WHOLE
    assert Recording(path).about.robots


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_leaves_a_closed_file_with_a_result(tmp_path: Path, number: signal.Signals, code: int) -> None:
    path = tmp_path / "run.mcap"
    with started(path, *FOR_EVER) as process:
        time.sleep(0.3)
        os.killpg(process.pid, number)
        process.communicate(timeout=60)
    assert process.returncode == code
    recording = Recording(path)
    assert not recording.truncated
    assert recording.result is not None
    assert recording.result.status == "interrupted"
    assert len(ticks_of(path)) * 0.05 == pytest.approx(recording.result.duration_s, abs=0.051)


def test_a_killed_writer_costs_the_recording_and_not_the_run(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    killed: list[int] = []

    def kill(recorder_pid: list[int] = killed) -> bool:
        if not recorder_pid:
            recorder_pid.append(writer_of(os.getpid()))
            os.kill(recorder_pid[0], signal.SIGKILL)
        return False

    run = run_mission(mission(duration_s=60.0), record=tmp_path / "run.mcap", follower=Follower(stop=kill))
    assert run.result.status == "completed"
    assert run.recording is not None
    assert "killed" in run.recording.failure
    assert run.recording.size_bytes == (tmp_path / "run.mcap").stat().st_size > 0
    assert "killed" in caplog.text
    assert run.result.trace_sha256 == run_mission(mission(duration_s=60.0)).result.trace_sha256


def filled(path: Path, most_bytes: int) -> subprocess.CompletedProcess[str]:
    """Run and record for as long as no file grows larger than that."""
    arguments = ("--backend", "kinematic", "--planner", "straight-line", "--duration", "300", "--json", "-")
    return subprocess.run(
        [sys.executable, "-m", "soter.cli", "run", str(SURVEILLANCE), *arguments, "--force", "--record", str(path)],
        cwd=ROOT, capture_output=True, text=True, timeout=100,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes)),
    )  # fmt: skip


def test_a_full_disk_costs_the_end_of_the_recording_and_not_the_run(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorded(path, duration_s=1.0)
    before = path.read_bytes()
    done = filled(path, 500_000)
    assert '"status": "completed"' in done.stdout
    assert "File too large" in done.stderr
    assert "the recording is not complete" in done.stderr
    assert done.returncode == 3
    assert path.read_bytes() == before
    (part,) = (each for each in tmp_path.iterdir() if each != path)
    assert f"recording: {part} (" in done.stderr
    assert part.stat().st_size <= 500_000
    recording = Recording(part)
    assert recording.truncated
    assert 20.0 < ticks_of(part)[-1].time_s < 300.0


def test_a_recording_of_which_nothing_could_be_written_is_not_named(tmp_path: Path) -> None:
    done = filled(tmp_path / "run.mcap", 0)
    assert '"status": "completed"' in done.stdout
    assert done.returncode == 3
    assert "no recording: File too large" in done.stderr
    assert "recording: /" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_device_that_is_full_from_the_beginning_costs_only_the_recording(caplog: pytest.LogCaptureFixture) -> None:
    run = recorded(Path("/dev/full"), duration_s=20.0)
    assert run.result.status == "completed"
    assert run.recording is not None
    assert run.recording.failure == "No space left on device"
    assert "No space left on device" in caplog.text


def test_in_virtual_time_a_run_waits_for_a_writer_that_does_not_follow(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with started(path, *FOR_EVER[:-1], "300") as process:
        writer = writer_of(process.pid)
        os.kill(writer, signal.SIGSTOP)
        time.sleep(1.0)
        # It has filled the pipe by now and waits.
        before = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
        time.sleep(0.5)
        after = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
        os.kill(writer, signal.SIGCONT)
        process.communicate(timeout=100)
    assert sum(map(int, after)) - sum(map(int, before)) <= 10
    assert process.returncode == 0
    assert len(ticks_of(path)) == 300 * 20
    assert Recording(path).content().drops == []


def test_a_run_that_waits_for_a_stopped_writer_ends_when_it_is_told_to(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with started(path, *FOR_EVER) as process:
        os.kill(writer_of(process.pid), signal.SIGSTOP)
        time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=100)
    assert process.returncode == 128 + signal.SIGTERM
    assert prove(path).state is DigestState.WHOLE


def test_on_a_wall_clock_nobody_waits_and_what_is_dropped_is_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    # Whether to wait is all that a wall clock changes for the recorder: the run itself is one in virtual time.
    path = tmp_path / "run.mcap"
    stopped: list[int] = []

    class Unwaiting(Recorder):
        def __init__(self, path: Path, *, waits: bool, **named: Any) -> None:
            super().__init__(path, waits=False, **named)

        def tick(self, now_s: float, tick: int) -> None:
            pid = self.writer_pid
            assert pid is not None
            if tick == 100:
                os.kill(pid, signal.SIGSTOP)
                stopped.append(pid)
            if tick == 9000:
                os.kill(pid, signal.SIGCONT)
                time.sleep(0.5)
            before_s = time.perf_counter()
            super().tick(now_s, tick)
            assert time.perf_counter() - before_s < 1.0

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("soter.runner.run.Recorder", Unwaiting)
        run = run_mission(mission(duration_s=600.0), record=path)
    assert stopped
    assert run.recording is not None
    assert run.recording.failure == ""
    assert 1000 < run.recording.dropped_ticks < 9000
    assert "does not follow" in caplog.text
    recording = Recording(path)
    content = recording.content()
    assert content.dropped_ticks == run.recording.dropped_ticks
    assert content.ticks == 12000 - content.dropped_ticks
    numbers = [tick.tick for tick in recording.ticks() if tick.robots]
    (drop,) = content.drops
    assert numbers == [*range(drop.first_tick), *range(drop.first_tick + drop.ticks, 12000)]


def test_a_file_that_was_cut_off_anywhere_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    whole, part = tmp_path / "whole.mcap", tmp_path / "part.mcap"
    recorded(whole, duration_s=120.0)
    data = whole.read_bytes()
    all_ticks = ticks_of(whole)
    draw = random.Random("cuts")
    read, unreadable = set(), [0]
    for _ in range(20):
        part.write_bytes(data[: draw.randrange(len(data))])
        try:
            recording = Recording(part)
        except BadRecording:
            unreadable.append(part.stat().st_size)
            continue
        ticks = ticks_of(part)
        assert ticks == all_ticks[: len(ticks)]
        assert recording.truncated
        read.add(len(ticks))
    assert len(read) > 1
    # Only what was cut off before the run had said what it is.
    assert max(unreadable) < 20_000


def test_damage_is_found(tmp_path: Path) -> None:
    whole, part = tmp_path / "whole.mcap", tmp_path / "part.mcap"
    recorded(whole, duration_s=60.0)
    data = bytearray(whole.read_bytes())
    data[len(data) // 2] ^= 0x10
    part.write_bytes(data)
    with pytest.raises(BadRecording):
        list(Recording(part).messages())


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    with pytest.raises(BadRecording, match=r"cannot be read: No such file or directory$"):
        Recording(other)
    other.write_bytes(b"nothing")
    with pytest.raises(BadRecording, match=r"No such file or directory, did you mean 'other\.mcap'\?"):
        Recording(tmp_path / "othr.mcap")
    with pytest.raises(BadRecording):
        Recording(other)
    other.write_bytes(b"")
    with pytest.raises(BadRecording):
        Recording(other)


def test_a_place_that_cannot_be_written_is_refused_before_anything_moves(tmp_path: Path) -> None:
    from soter.errors import ConfigError

    with pytest.raises(ConfigError, match="cannot be recorded to"):
        recorded(tmp_path / "absent" / "run.mcap", duration_s=1.0)


@pytest.fixture(autouse=True)
def _logs(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)


def test_a_killed_rerun_leaves_the_recording_that_was_there(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorded(path, duration_s=1.0)
    before = path.read_bytes()
    with started(path, *FOR_EVER, "--force") as process:
        wait_until(lambda: any(each.stat().st_size for each in tmp_path.glob("run.mcap.*.new")))
        writer = writer_of(process.pid)
        os.killpg(process.pid, signal.SIGKILL)
        wait_until(lambda: gone(writer))
    assert path.read_bytes() == before
    (new,) = tmp_path.glob("run.mcap.*.new")
    assert Recording(new).result is None


def test_a_stopped_writer_does_not_hold_the_end_up(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with started(path, *FOR_EVER) as process:
        os.kill(writer_of(process.pid), signal.SIGSTOP)
        os.killpg(process.pid, signal.SIGTERM)
        process.communicate(timeout=60)
    assert Recording(path).result is not None

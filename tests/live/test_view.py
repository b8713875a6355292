"""The run's end of a view: whatever happens to a view, the run goes on; a view ends with its run."""

from __future__ import annotations

import http.client
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from soter.errors import ConfigError
from soter.live.view import PAGE, Kind, LiveView
from soter.runner import Follower, run_mission
from tests.project.source import ROOT
from tests.record.helpers import SURVEILLANCE, mission
from tests.waiting import gone, wait_until

QUICK = ("--backend", "kinematic", "--planner", "straight-line", "--no-record")


def status_of(address: str) -> int:
    """What the live page answers."""
    connection = http.client.HTTPConnection(address.removeprefix("http://").rstrip("/"), timeout=20.0)
    connection.request("GET", "/")
    status = connection.getresponse().status
    connection.close()
    return status


def test_a_view_is_there_at_once_and_ends_with_the_run() -> None:
    with LiveView(PAGE) as view:
        assert status_of(view.address) == 503
        pid = view.pid
    assert gone(pid)


def test_a_port_that_is_taken_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"--live-port: the live page: port {port} of 127.0.0.1 cannot be had: "
                                              "Address already in use; name another"):  # fmt: skip
            LiveView(PAGE, port)


def test_a_process_that_cannot_start_is_refused() -> None:
    with pytest.raises(ConfigError, match="its process has ended: exit code 1"):
        LiveView(Kind("soter.live.absent", "the view", "--view-port", ""))


def test_a_run_is_shown_up_to_its_end_and_costs_it_no_decision(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    with LiveView(PAGE) as view:
        run = run_mission(
            mission(duration_s=60.0), record=tmp_path / "run.mcap", follower=Follower(recording=view.begin)
        )
        assert status_of(view.address) == 200
    assert gone(view.pid)
    assert run.result.trace_sha256 == run_mission(mission(duration_s=60.0)).result.trace_sha256
    assert caplog.text == ""


def test_a_view_that_is_killed_is_missed_once_and_the_run_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    with LiveView(PAGE) as view:

        def kill(path: Path) -> None:
            view.begin(path)
            os.kill(view.pid, signal.SIGKILL)

        run = run_mission(mission(duration_s=60.0), record=tmp_path / "run.mcap", follower=Follower(recording=kill))
        wait_until(lambda: "has ended" in caplog.text)
        view.begin(tmp_path / "run.mcap")
    assert run.result.status == "completed"
    assert run.recording is not None
    assert run.recording.failure == ""
    assert [record.message for record in caplog.records] == [
        "the live page has ended: signal SIGKILL; the run goes on"
    ]  # fmt: skip


def test_a_recording_that_is_none_ends_the_view_which_says_why(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    path = tmp_path / "run.mcap"
    path.write_bytes(b"no recording at all, but long enough to be looked at")
    with LiveView(PAGE) as view:
        view.begin(path)
        wait_until(lambda: "no MCAP file" in caplog.text)


def test_a_run_that_is_killed_takes_its_view_along() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "soter.cli", "run", str(SURVEILLANCE), *QUICK, "--duration", "1e6", "-q", "--live"],
        cwd=ROOT, stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    with process:
        assert process.stdout is not None
        address = re.search(r"http://127\.0\.0\.1:\d+/", process.stdout.readline())
        assert address is not None
        wait_until(lambda: status_of(address[0]) == 200)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.kill()
        process.wait()
        began_s = time.monotonic()
        wait_until(lambda: all(gone(int(child)) for child in children))
        assert time.monotonic() - began_s < 10.0
        with pytest.raises(ConnectionError):
            status_of(address[0])

"""`soter run --live` and `--foxglove`: what they say, and how they exit."""

from __future__ import annotations

import http.client
import importlib.util
import os
import re
import signal
import socket
import subprocess
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Final

import pytest
from typer.testing import CliRunner, Result

from soter.cli import app
from soter.cli import live as cli_live
from soter.record.reader import Recording
from tests.project.source import ROOT
from tests.record.helpers import SURVEILLANCE, mission
from tests.report.unpacked import Unpacked, of_page
from tests.waiting import wait_until

RECORDING: Final = 'id="recording"'
QUICK = ("--backend", "kinematic", "--planner", "straight-line", "--duration", "20")


def ran(*arguments: str | Path) -> Result:
    """A command in this process."""
    return CliRunner().invoke(app, ["run", str(SURVEILLANCE), *QUICK, *map(str, arguments)], env={"COLUMNS": "200"})


def test_it_says_where_to_look(tmp_path: Path) -> None:
    done = ran("--live", "--leave", "--record", tmp_path / "run.mcap")
    assert done.exit_code == 0
    assert re.match(r"the live page: http://127\.0\.0\.1:\d+/\nrunning ", done.stdout)
    assert Recording(tmp_path / "run.mcap").content().ticks == 400


def test_a_port_can_be_named(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    done = ran("--live", "--leave", "--live-port", str(port), "-q", "--record", tmp_path / "run.mcap")
    assert done.exit_code == 0
    assert done.stdout == f"the live page: http://127.0.0.1:{port}/\n"


def test_without_a_recording_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    done = ran("--live", "--leave", "--no-record")
    assert done.exit_code == 0
    assert "recording:" not in done.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--live", "--foxglove"])
def test_a_port_that_is_taken_is_refused_before_anything_moves(tmp_path: Path, option: str) -> None:
    path = tmp_path / "run.mcap"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        done = ran(option, f"{option}-port", port, "--record", path)
    assert done.exit_code == 2
    assert f"command line: {option}-port: " in done.stderr
    assert f"port {port} of 127.0.0.1 cannot be had: " in done.stderr
    assert "name another" in done.stderr
    assert not path.exists()


@pytest.mark.parametrize("option", ["--live", "--foxglove"])
def test_a_port_for_nothing_is_refused(option: str) -> None:
    done = ran(f"{option}-port", "8000", "--no-record")
    assert done.exit_code == 2
    assert f"command line: {option}-port: it says how, but not what: add {option}" in done.stderr


@pytest.mark.parametrize("port", ["0", "65536", "-1", "http"])
def test_what_is_no_port_is_refused(port: str) -> None:
    assert ran("--live", "--live-port", port, "--no-record").exit_code == 2


def test_without_its_library_the_app_is_refused_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec

    def find_spec(name: str, package: str | None = None) -> ModuleSpec | None:
        return None if name == "foxglove" else found(name, package)

    monkeypatch.setattr("importlib.util.find_spec", find_spec)
    done = ran("--foxglove", "--no-record")
    assert done.exit_code == 2
    assert (
        "command line: --foxglove: it needs foxglove-sdk, which is not installed; install it with: pip install "
        in done.stderr
    )
    assert "[foxglove]" in done.stderr


def test_a_run_that_is_refused_ends_its_views_and_is_opened_in_no_browser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    done = ran("--live", "--open", "--record", tmp_path / "run.mcap", "--set", "rta.collision.delta_s=3.0")
    assert not opened
    assert done.exit_code == 2
    assert "ill-formed" in done.stderr
    assert not (tmp_path / "run.mcap").exists()


def test_a_finished_run_stays_on_the_page_from_its_beginning_until_ctrl_c(tmp_path: Path) -> None:
    seen = tmp_path / "seen"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > {seen}\n', encoding="utf-8")
    browser.chmod(0o755)
    command = [sys.executable, "-m", "soter.cli", "run", str(SURVEILLANCE), *QUICK, "-q", "--no-record"]
    environment = {**os.environ, "BROWSER": str(browser)}
    with subprocess.Popen(
        [*command, "--live", "--open"], cwd=ROOT, stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().removeprefix("the live page: ").strip()
            assert process.stdout.readline() == f"the page stays until Ctrl-C: {address}\n"
            wait_until(lambda: seen.exists() and seen.read_text(encoding="utf-8").strip() == address)
            # Its process may not have read all of the recording yet.
            wait_until(lambda: RECORDING in text_at(address) and not page_at(address).document["goesOn"])
            data = page_at(address)
            times = data.column(data.document["robots"][0]["poses"]["timeS"])
            assert (times[0], times[-1]) == pytest.approx((0.0, 20.0), abs=0.06)
            process.send_signal(signal.SIGINT)
            assert process.wait(30.0) == 0
        finally:
            process.kill()


def page_at(address: str) -> Unpacked:
    """The data of the page that a server has now."""
    return of_page(text_at(address))


def text_at(address: str) -> str:
    """The page that a server has now; one that asks again in a second while nothing has been recorded."""
    connection = http.client.HTTPConnection(address.removeprefix("http://").rstrip("/"), timeout=20.0)
    connection.request("GET", "/")
    text = connection.getresponse().read().decode()
    connection.close()
    return text


def test_a_pace_holds_virtual_time_to_the_clock_and_makes_up_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    host_s = 100.0
    slept: list[float] = []

    def sleep(duration_s: float) -> None:
        nonlocal host_s
        slept.append(duration_s)
        host_s += duration_s

    monkeypatch.setattr("soter.cli.live.time.monotonic", lambda: host_s)
    monkeypatch.setattr("soter.cli.live.time.sleep", sleep)
    stopped = False
    pace = cli_live.pace_of(2.0, mission(), lambda: stopped)
    assert pace is not None
    pace(0.05)
    pace(0.15)
    assert host_s == pytest.approx(100.05)
    host_s += 5.0  # the host has stood still
    before_s = host_s
    pace(0.2)
    pace(0.3)
    assert host_s == pytest.approx(before_s + 0.05)
    stopped = True
    count = len(slept)
    pace(100.0)
    assert len(slept) == count


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("--open",), "--open"),
        (("--leave",), "--leave"),
        (("--backend", "mavlink", "--pace", "1"), "--pace"),
    ],
)
def test_what_is_said_of_no_page_or_of_robots_with_a_clock_of_their_own_is_refused(
    arguments: tuple[str, ...], key: str
) -> None:
    done = ran(*arguments, "--no-record")
    assert done.exit_code == 2
    assert f"command line: {key}: " in done.stderr

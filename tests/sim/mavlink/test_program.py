"""`python -m soter_sim.mavlink` and `soter sim mavlink`: start, end, pace, and what is refused."""

from __future__ import annotations

import io
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav
from typer.testing import CliRunner

from soter.cli.app import app
from soter.clock import VehicleClock
from soter.sdk.truth import StreamedTruth
from soter.sdk.values import RobotSpec
from soter_sim.mavlink.__main__ import main
from soter_sim.mavlink.simulation import Settings, Simulation
from tests.project.source import ROOT
from tests.sim.mavlink.client import CUSTOM, HOST, Client
from tests.sim.mavlink.programs import WORLD, finished, vehicles, world_of
from tests.sim.worlds import empty
from tests.waiting import eventually

WORKSPACE = "examples/surveillance.xml"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_where_it_is_drives_tells_the_truth_and_ends_when_told_to(number: signal.Signals) -> None:
    with vehicles("--tcp", "0", "--speedup", "5", "--boot", "0.5") as (process, ready):
        assert ready["robots"] == [1, 2]
        client = Client(ready["links"][0])
        truth = StreamedTruth(ready["truth"], VehicleClock(rate=5.0, rate_tolerance=0.5))
        try:

            def send(number: int, *params: float) -> None:
                client.send(mav.MAVLink_command_long_message(2, 1, number, 0, *params, *[0.0] * (7 - len(params))))

            def drives() -> bool:
                send(mav.MAV_CMD_DO_SET_MODE, CUSTOM, 15)
                send(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
                client.send(
                    mav.MAVLink_set_position_target_local_ned_message(
                        0, 2, 1, 1, 0x0DF8, 6.0, 7.0, 0, 0, 0, 0, 0, 0, 0, 0, 0
                    )
                )
                return truth.pose(2)[1] > 5.3

            assert eventually(drives)
            assert truth.pose(1) == (5.0, 5.0, 0.0)
            assert truth.report().violations == ()
            assert 0.4 < truth.report().min_margin["battery"] <= 0.5
        finally:
            truth.close()
            client.close()
        process.send_signal(number)
        assert process.wait(10.0) == 0


def test_it_ends_with_its_parent() -> None:
    program = (
        "import os, subprocess, sys\n"
        "from tests.sim.mavlink.programs import WORLD\n"
        "child = subprocess.Popen([sys.executable, '-m', 'soter_sim.mavlink', '--tcp', '0', '--parent', "
        "str(os.getpid())], stdin=subprocess.PIPE, stdout=subprocess.PIPE)\n"
        "child.stdin.write(WORLD); child.stdin.close()\n"
        "child.stdout.readline(); print(child.pid)\n"
    )
    path = os.pathsep.join((str(ROOT), str(ROOT / "sim")))
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env={**os.environ, "PYTHONPATH": path}, capture_output=True,
        text=True, check=True, timeout=60.0,
    )  # fmt: skip
    child = int(done.stdout)

    def gone() -> bool:
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return True
        # A child that nobody waits for stays as a zombie where no init looks after it.
        return Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] == "Z"

    assert eventually(gone)


@pytest.mark.parametrize(
    ("arguments", "world", "message"),
    [
        ([], WORLD, "udp and tcp are empty"),
        (["--tcp", "70000"], WORLD, "tcp is 70000, allowed: a port from 0 to 65535"),
        (["--udp", "0"], WORLD, "udp is 0, allowed: a port from 1 to 65535"),
        (["--tcp", "0", "--vehicle", "boat"], WORLD, "vehicle is 'boat', allowed: rover, copter"),
        (["--tcp", "0", "--engine", "steam"], WORLD, "engine is 'steam', allowed: kinematic, pybullet"),
        (["--tcp", "0", "--vehicle", "copter", "--engine", "pybullet"], WORLD, "allowed for a copter: kinematic"),
        (["--tcp", "0", "--engine", "pybullet", "--rate", "50"], WORLD, "rate_hz is 50.0, allowed with the engine"),
        (["--tcp", "0", "--rate", "1000"], WORLD, "rate_hz is 1000.0, allowed: 10 to 200"),
        (["--tcp", "0", "--streams", "0.5"], WORLD, "streams_hz is 0.5, allowed: 1 to 200"),
        (["--tcp", "0", "--speedup", "0"], WORLD, "speedup is 0.0, allowed: above 0"),
        (["--tcp", "0", "--boot", "-1"], WORLD, "boot_s is -1.0, allowed: 0 or more"),
        (["--tcp", "0", "--origin", "north"], WORLD, "origin is 'north', allowed: LATITUDE,LONGITUDE,ALTITUDE"),
        (["--tcp", "0", "--origin", "89,0,0"], WORLD, "the latitude from -85 to 85"),
        (["--tcp", "0", "--origin", "nan,0,0"], WORLD, "origin is 'nan,0,0'"),
        (["--tcp", "0", "--sign", "/nowhere"], WORLD, "/nowhere: the passphrase cannot be read"),
        (["--tcp", "0"], world_of(RobotSpec(1, 5.0, 5.0, 0.0), RobotSpec(1, 7.0, 5.0, 0.0)), "each number once"),
        (["--tcp", "0"], b"{}", "standard input holds no world"),
    ],
)
def test_what_is_not_allowed_is_named_and_nothing_starts(
    arguments: list[str],
    world: bytes,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["mavlink", *arguments])
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(world)))
    assert main() == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert message in err


def test_a_world_that_is_none_ends_it_without_a_traceback() -> None:
    done = finished("--tcp", "0", world=b"[]")
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.startswith(b"error: ")
    assert len(done.stderr.splitlines()) == 1


def test_the_speed_up_is_a_ceiling() -> None:
    settings = Settings(tcp=(0,), speedup=20.0, boot_s=0.0)
    with Simulation(empty(), [RobotSpec(1, 5.0, 5.0, 0.0)], settings) as simulation:
        began_s = time.perf_counter()
        simulation.run(lambda: simulation.world.now_s < 6.0)
        took_s = time.perf_counter() - began_s
        # Up to a quarter of a simulated second is made up for, and no more.
        assert took_s >= (6.0 - 0.25) / 20.0 - 0.01
        assert simulation.world.now_s == pytest.approx(6.0, abs=0.05)


def test_a_host_that_lags_slows_the_world_down() -> None:
    with Simulation(empty(), [RobotSpec(1, 5.0, 5.0, 0.0)], Settings(tcp=(0,), boot_s=0.0)) as simulation:
        began_s = time.perf_counter()
        lagged = False

        def alive() -> bool:
            nonlocal lagged
            if not lagged and simulation.world.now_s > 0.2:
                lagged = True
                # The host is held up.
                time.sleep(1.0)
            return simulation.world.now_s < 0.8

        simulation.run(alive)
        took_s = time.perf_counter() - began_s
        # A second was lost, and of it at most a quarter was made up for.
        assert took_s >= 0.8 + 1.0 - 0.25 - 0.05


def test_stopping_ends_a_run() -> None:
    with Simulation(empty(), [RobotSpec(1, 5.0, 5.0, 0.0)], Settings(tcp=(0,))) as simulation:
        simulation.stop()
        simulation.run()
        assert simulation.world.now_s == 0.0


@pytest.mark.parametrize(
    ("arguments", "lines"),
    [
        (
            ["--tcp", "--port", "0", "--robots", "1"],
            [
                "rover with system id 1",
                "mavproxy.py --master=tcp:127.0.0.1:",
                'add_any_connection("tcpout://127.0.0.1:',
            ],
        ),
        (
            ["--port", "24999", "--vehicle", "copter", "--seed", "3"],
            ["copters with system ids 1, 2", "udpin:127.0.0.1:24999", 'add_any_connection("udpin://127.0.0.1:24999")'],
        ),
    ],
)
def test_the_command_says_how_to_connect_and_ends_with_ctrl_c(arguments: list[str], lines: list[str]) -> None:
    command = [sys.executable, "-m", "soter.cli", "sim", "mavlink", WORKSPACE, *arguments]
    path = os.pathsep.join((str(ROOT), str(ROOT / "sim")))
    with subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stderr is not None
            said = ""
            while "truth " not in said:
                line = process.stdout.readline()
                assert line, process.stderr.read()
                said += line
            process.send_signal(signal.SIGINT)
            assert process.wait(10.0) == 0
            assert process.stderr.read() == ""
        finally:
            process.kill()
    for line in lines:
        assert line in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.xml"], "nowhere.xml"),
        ([WORKSPACE, "--robots", "9"], "9 robots were asked for"),
        ([WORKSPACE, "--port", "0"], "udp is 0"),
        ([WORKSPACE, "--speedup", "-1"], "speedup is -1.0"),
        ([WORKSPACE, "--vehicle", "copter", "--engine", "pybullet"], "allowed for a copter: kinematic"),
    ],
)
def test_the_command_refuses_what_is_not_allowed(
    arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    done = CliRunner().invoke(app, ["sim", "mavlink", *arguments])
    assert done.exit_code == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_the_command_names_a_port_that_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    with socket.create_server((HOST, 0)) as taken:
        port = taken.getsockname()[1]
        done = CliRunner().invoke(app, ["sim", "mavlink", WORKSPACE, "--tcp", "--port", str(port)])
    assert done.exit_code == 2
    assert f"port {port} of 127.0.0.1 cannot be listened on" in done.stderr

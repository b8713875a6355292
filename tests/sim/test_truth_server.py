from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable

import pytest

from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import RobotSpec
from soter.sdk.truth import StreamedTruth
from soter_sim import World
from soter_sim.truth_server import TruthServer

ROOM = Workspace(3.0, 3.0, (), (RobotPlace(1, 1.0, 1.5, Box(0.9, 1.4, 1.1, 1.6)),))


def straight_on(*_state: float) -> tuple[float, float]:
    return 0.2, 0.0


def eventually(holds: Callable[[], bool], tell: Callable[[], None]) -> bool:
    until_s = time.monotonic() + 5.0
    while time.monotonic() < until_s:
        tell()
        if holds():
            return True
        time.sleep(0.005)
    return False


class Telling:
    """A server that tells in a thread until it is closed."""

    def __init__(self, world: World) -> None:
        self.server = TruthServer(world)
        self.done = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self) -> None:
        while not self.done.wait(0.005):
            self.server.tell()
        self.server.close()

    def close(self) -> None:
        self.done.set()
        self.thread.join()


def test_poses_violations_and_margins_arrive_in_fleet_time() -> None:
    with World(ROOM, [RobotSpec(1, 1.0, 1.5, 0.3)]) as world:
        world.set_control(1, straight_on)
        world.advance(12.0)
        telling = Telling(world)
        clock = VehicleClock()
        truth = StreamedTruth(telling.server.address, clock)
        try:
            x_m, y_m, heading_rad = truth.pose(1)
            there = world.truth.pose(1)
            # Moved on to the time of asking: at most a tenth of a second at 0.2 m/s.
            assert math.hypot(x_m - there[0], y_m - there[1]) <= 0.021
            assert heading_rad == pytest.approx(there[2])
            report, real = truth.report(), world.truth.report()
            assert [(each.rule, each.robots) for each in report.violations] == [("geofence", (1,))]
            assert report.violations[0].end_s is None
            # World time 12 s was heard at fleet time 0 or so.
            assert report.violations[0].start_s == pytest.approx(real.violations[0].start_s - 12.0, abs=1.0)
            assert report.min_margin == real.min_margin
            assert report.contacts == 0
        finally:
            truth.close()
            telling.close()


def test_a_reader_that_does_not_read_is_let_go_of_and_costs_the_others_nothing() -> None:
    with World(ROOM, [RobotSpec(1, 1.0, 1.5, 0.3)]) as world:
        server = TruthServer(world)
        host, _, port = server.address.rpartition(":")
        with socket.create_connection((host, int(port))) as sleeper:
            sleeper.settimeout(5.0)
            began_s = time.perf_counter()
            for _ in range(60_000):
                server.tell()
            assert time.perf_counter() - began_s < 60.0
            # The end of what was sent to it is the end of the connection.
            while sleeper.recv(1 << 20):
                pass
        with socket.create_connection((host, int(port))) as reader:
            assert eventually(lambda: True, server.tell)
            assert reader.recv(1 << 16).startswith(b'{"time_s"')
        server.close()


def test_nobody_there_and_nonsense_are_one_clear_error() -> None:
    with pytest.raises(RobotUnavailable, match=r"127\.0\.0\.1:1 .* is the simulator running"):
        StreamedTruth("127.0.0.1:1", VehicleClock(), 0.5)
    with pytest.raises(RobotUnavailable, match="address"):
        StreamedTruth("nowhere", VehicleClock(), 0.5)
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def talk_nonsense() -> None:
            with listener.accept()[0] as reader:
                reader.sendall(b'[1]\n{"time_s": 1}\nnonsense\n')
                reader.recv(1)

        talking = threading.Thread(target=talk_nonsense)
        talking.start()
        with pytest.raises(RobotUnavailable, match="silent"):
            StreamedTruth(f"127.0.0.1:{listener.getsockname()[1]}", VehicleClock(), 0.5)
        talking.join()


def test_a_world_that_falls_behind_the_clock_is_not_silent() -> None:
    with World(ROOM, [RobotSpec(1, 1.0, 1.5, 0.3)]) as world:
        server = TruthServer(world)
        now = [0.0]
        clock = VehicleClock(steady=lambda: now[0])
        told = threading.Thread(target=lambda: eventually(lambda: bool(server._readers), server.tell))
        told.start()
        truth = StreamedTruth(server.address, clock)
        told.join()
        # Ten seconds pass, and the world has come five of them.
        for _ in range(100):
            now[0] += 0.1
            world.advance(world.now_s + world.period_s)
            time_s = world.now_s
            server.tell()
            assert eventually(lambda: truth._told()["time_s"] == time_s, lambda: None)  # noqa: B023
        assert truth.report().ended_s is None
        truth.close()
        server.close()


def test_a_simulator_that_is_gone_is_said_to_be(caplog: pytest.LogCaptureFixture) -> None:
    with World(ROOM, [RobotSpec(1, 1.0, 1.5, 0.3)]) as world:
        telling = Telling(world)
        now = [0.0]
        truth = StreamedTruth(telling.server.address, VehicleClock(steady=lambda: now[0]))
        telling.close()
        now[0] = 5.0
        truth.report()
        truth.report()
        truth.close()
    assert [record.message for record in caplog.records if "silent" in record.message] == [
        "the simulator has been silent for 5.0 s; what happened since then is not known"
    ]

"""A mission in a process of its own: whatever it does, the ticks go on and the robots end with their SCs."""

from __future__ import annotations

import json
import os
import resource
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from soter.cli.run import _exit_code
from soter.config import MissionFile, load_mission
from soter.errors import ConfigError, RunFailed
from soter.isolation.messages import MAX_TURN_BYTES, Started, decode_up
from soter.runner import Follower, Run, mission_process, run_mission
from soter.runner.remote_host import NICENESS, RemoteMissionHost
from soter.sdk import RobotSpec
from soter.sdk.wire import Simulator
from soter_zmq.adapter import ZmqRobot
from tests.waiting import gone, wait_until

EXAMPLES = Path(__file__).parents[2] / "examples"
SURVEILLANCE = EXAMPLES / "surveillance.toml"
ADAPTER = EXAMPLES / "adapter-zmq"
ZMQ = "soter_zmq.adapter:ZmqBackend"
SILENT_S = 1.0
LATEST_MS = 1e3 * SILENT_S / 2.0
"""A tick that waits for a mission that hangs would be later."""

HEARD_S = 0.3
"""Until the test hears of it, on a busy host."""

QUICK = {"backend": ZMQ, "planner": "straight-line", "duration_s": 4.0, "isolation.silent_s": SILENT_S}


def mission(ac: str = "mission", **overrides: Any) -> MissionFile:
    """A short mission on a wall clock; double underscores in names stand for dots."""
    name = ac if ac == "mission" or ":" in ac else f"tests.runner.hostile:{ac}"
    given = {key.replace("__", "."): value for key, value in overrides.items()}
    return load_mission(SURVEILLANCE, {**QUICK, "ac": name, **given})


@pytest.fixture
def hosts(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[RemoteMissionHost]]:
    """The sides that a test makes; none of their processes is left when it ends."""
    made: list[RemoteMissionHost] = []

    class Noted(RemoteMissionHost):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            made.append(self)

    monkeypatch.setattr("soter.runner.run.RemoteMissionHost", Noted)
    yield made
    assert all(gone(host.pid) for host in made)


def in_ac(run: Run, since_s: float, until_s: float) -> bool:
    """Whether any robot was with its AC at any time between."""
    return any(
        driver == 0
        for track in run.tracks.tracks.values()
        for time_s, driver in zip(track.time_s, track.driver, strict=True)
        if since_s <= time_s - track.time_s[0] <= until_s
    )


@pytest.mark.parametrize(
    ("ac", "words"),
    [
        ("Hangs", "silent for 1 s of host time; it is in handler Hangs.act"),
        ("Spins", "silent for 1 s of host time; it is in handler Spins.act"),
        ("SpinsInC", "silent for 1 s of host time"),
        ("Exits", "its process has ended with exit code 7"),
        ("Crashes", "its process has ended with signal SIGSEGV"),
        ("Chatters", "silent for 1 s of host time; it is in handler Chatters.act"),
        ("FloodsWithTurns", "garbage: an answer to tick"),
        ("FloodsWithGarbage", "garbage: "),
        ("SendsTooMuch", "garbage: a message of more than 65536 bytes"),
        ("NeverReads", "garbage: an answer to tick"),
        ("Closes", "its process has closed the link"),
        ("Detaches", "its process has ended with exit code 0"),
    ],
)
def test_a_hostile_mission_costs_its_robots_the_ac_and_no_tick(
    ac: str, words: str, hosts: list[RemoteMissionHost]
) -> None:
    run = run_mission(mission(ac))
    result = run.result
    assert result.status == "failed"
    assert _exit_code(result, None) == 3
    assert words in result.failure
    judge(run, words)
    assert len(hosts) == 1


def test_a_policy_that_is_loaded_for_longer_than_a_mission_may_be_silent_drives_afterwards(
    hosts: list[RemoteMissionHost],
) -> None:
    run = run_mission(mission("LoadsForLong", duration_s=6.0))
    assert run.result.status == "completed"
    assert not run.result.failure
    assert in_ac(run, 2.5, 6.0)
    assert max(track.x_m[-1] - track.x_m[0] for track in run.tracks.tracks.values()) > 0.05


def test_a_run_that_is_over_before_its_policy_is_loaded_has_failed(hosts: list[RemoteMissionHost]) -> None:
    result = run_mission(mission("LoadsForLong", duration_s=1.0)).result
    assert result.status == "failed"
    assert result.failure.startswith("the mission has not begun")
    assert len(hosts) == 1


def test_a_missions_process_makes_its_terrains_before_it_says_that_it_has_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Those of a large workspace take longer than a mission may be silent for.
    made: list[float] = []
    monkeypatch.setattr(mission_process, "terrain_of", lambda workspace, radius_m: made.append(radius_m))
    chosen = mission()
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here, there:
        spec = mission_process.MissionSpec(
            "soter.runner.hosts:make_host", chosen, chosen.read_workspace(), {1: 0.1, 2: 0.2}, 0, 0
        )
        host = mission_process._Host(spec, there)._made()
        assert host is not None
        host.close()
        assert isinstance(decode_up(here.recv(MAX_TURN_BYTES)), Started)
    assert sorted(made) == [0.1, 0.2]


@pytest.mark.parametrize(("ac", "words"), [("EatsMemory", "MemoryError"), ("Raises", "no way")])
def test_acs_that_raise_cost_their_robots_the_ac(ac: str, words: str, hosts: list[RemoteMissionHost]) -> None:
    run = run_mission(mission(ac, isolation__memory_mib=64))
    assert run.result.status == "completed"
    judge(run, words)
    assert len(hosts) == 1


def judge(run: Run, words: str) -> None:
    """Whether the robots had their AC, lost it for a cause with these words, and nothing else came of it."""
    result = run.result
    assert set(result.failed_robots) == {1, 2}
    assert all(words in cause for cause in result.failed_robots.values())
    assert in_ac(run, 0.0, 2.5), "the robots were with their AC before it turned"
    assert not in_ac(run, 3.5, 4.0)
    assert result.duration_s == 4.0, "the SCs had the robots to the end"
    assert not result.violated
    assert result.tick_late_ms is not None
    assert result.tick_late_ms.max < LATEST_MS
    assert not result.deterministic


@pytest.mark.ompl
def test_a_mission_drives_through_two_processes_as_through_one(hosts: list[RemoteMissionHost], tmp_path: Path) -> None:
    recorded = tmp_path / "run.mcap"
    run = run_mission(mission(duration_s=5.0, targets="uniform", planner="ompl-bitstar"), record=recorded)
    result = run.result
    assert result.status == "completed"
    assert not result.failed_robots
    assert not result.violated
    assert result.ac_share > 0.5
    assert result.answered is not None
    assert 0.0 < result.answered <= 1.0
    assert all(len(set(track.x_m)) > 5 for track in run.tracks.tracks.values()), "both robots drove"
    with recorded.open("rb") as file:
        moves = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages("/machines")]
    assert {"TaskPlanner", "RobotAgent 1", "PlanExecutor 2"} <= {move["machine"] for move in moves}
    assert "Executing" in {move.get("target") for move in moves}


def test_bad_options_of_the_mission_are_refused_before_anything_moves(hosts: list[RemoteMissionHost]) -> None:
    with pytest.raises(ConfigError, match=r"planners.straight-line.speed") as refused:
        run_mission(mission(planners={"straight-line": {"speed": 3}}))
    assert refused.value.key is not None


def test_the_mission_is_favoured_less_limited_and_taken_first() -> None:
    asked = mission(isolation__memory_mib=64)
    host = RemoteMissionHost(asked, asked.read_workspace(), {1: 0.1, 2: 0.1})
    try:
        host.ready()
        # Around it there are the processes of its box, where there are namespaces.
        pid = [host.pid, *children(host.pid)][-1]
        assert os.getpriority(os.PRIO_PROCESS, pid) == min(os.getpriority(os.PRIO_PROCESS, 0) + NICENESS, 19)
        assert Path(f"/proc/{pid}/oom_score_adj").read_text() == "1000\n"
        assert resource.prlimit(pid, resource.RLIMIT_AS)[0] < 2**40
        assert os.getsid(pid) == host.pid != os.getsid(0)
    finally:
        host.close()
    wait_until(lambda: gone(pid))
    host.close()


def test_without_the_right_to_it_real_time_is_refused(
    hosts: list[RemoteMissionHost], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr("os.sched_setscheduler", refuse)
    with pytest.raises(ConfigError, match=r"isolation.real_time: .*CAP_SYS_NICE"):
        run_mission(mission(isolation__real_time="always"))


def test_a_mission_that_cannot_be_made_is_refused() -> None:
    asked = mission()
    workspace = asked.read_workspace()
    for factory, words in (
        ("os:getcwd", "could not be made: TypeError"),
        ("tests.runner.hostile:ends", r"could not be started \("),
    ):
        host = RemoteMissionHost(asked, workspace, {1: 0.1, 2: 0.1}, factory)
        try:
            with pytest.raises(RunFailed, match=words):
                host.ready()
        finally:
            host.close()
        assert gone(host.pid)


class Truth:
    """Hears how fast the robots really are, whoever commands them."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._socket = socket.create_connection((host, int(port)), 5.0)
        self._heard = b""

    def speed_m_s(self) -> float:
        """The fastest robot's speed, by the newest line that is there."""
        while self._heard.count(b"\n") < 2 or select.select([self._socket], [], [], 0.0)[0]:
            more = self._socket.recv(1 << 16)
            assert more, "the simulator is gone"
            self._heard = b"\n".join(self._heard.split(b"\n")[-3:]) + more
        speeds: dict[str, tuple[float, float]] = json.loads(self._heard.split(b"\n")[-2])["speeds"]
        return max(abs(speed) for speed, _ in speeds.values())

    def close(self) -> None:
        self._socket.close()


def children(pid: int) -> list[int]:
    """All that a process has started, and what that has started."""
    found = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, path.read_text().split()):
            found += [child, *children(child)]
    return found


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    """Robots in a process of their own, which a run does not start and does not end."""
    workspace = mission().read_workspace()
    specs = [RobotSpec(place.id, place.x_m, place.y_m, place.heading_rad) for place in workspace.robots]
    started = Simulator("soter_zmq.robot", workspace, specs)
    yield started
    started.close()


def mission_file(folder: Path, simulator: Simulator) -> Path:
    """A mission for the robots of a simulator."""
    lines = [
        f'workspace = "{SURVEILLANCE.with_suffix(".xml")}"',
        f'backend = "{ZMQ}"',
        f'[backends."{ZMQ}"]',
        f'truth = "{simulator.truth}"',
    ]
    for robot_id, addresses in simulator.robots.items():
        lines.append(f'[backends."{ZMQ}".robots.{robot_id}]')
        lines += [f'{name} = "{address}"' for name, address in addresses.items()]
    path = folder / "mission.toml"
    path.write_text("\n".join(lines))
    return path


@pytest.mark.ompl
def test_a_killed_supervisor_leaves_robots_at_rest_and_no_process(tmp_path: Path, simulator: Simulator) -> None:
    truth = Truth(simulator.truth)
    path = os.pathsep.join([str(ADAPTER), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "soter.cli", "run", str(mission_file(tmp_path, simulator)), "-q", "--no-record"]
    supervisor = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path})
    try:
        wait_until(lambda: truth.speed_m_s() > 0.1, 30.0)
        started = children(supervisor.pid)
        programs = " ".join(Path(f"/proc/{pid}/cmdline").read_text() for pid in started)
        assert "soter.runner.mission_process" in programs
        assert "soter.stack.planners.worker" in programs
        os.kill(supervisor.pid, signal.SIGKILL)
        killed_s = time.perf_counter()
        wait_until(lambda: truth.speed_m_s() == 0.0)
        declared = ZmqRobot.declared
        declared_s = declared.lease_s + declared.latency_s + declared.v_max_m_s / declared.brake_m_s2
        assert time.perf_counter() - killed_s < declared_s + HEARD_S
        wait_until(lambda: all(map(gone, started)), 2.0)
    finally:
        supervisor.kill()
        supervisor.wait()
        truth.close()


def test_a_world_that_ends_takes_the_truth_with_it(tmp_path: Path, simulator: Simulator) -> None:
    ticks = iter(range(10**6))

    def stop() -> bool:
        if next(ticks) == 30:
            simulator.process.kill()
        return False

    overrides = {"planner": "straight-line", "duration_s": 3.5}
    run = run_mission(load_mission(mission_file(tmp_path, simulator), overrides), follower=Follower(stop=stop))
    ticked_s = run.tracks.tracks[1].time_s
    assert run.result.status == "completed"
    assert run.result.violations is not None
    assert run.result.truth_ended_s is not None
    assert ticked_s[0] + 1.4 < run.result.truth_ended_s < ticked_s[-1] - 1.0

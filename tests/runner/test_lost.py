"""A run whose world ends under it has failed, whichever process of it was killed; who waits for one can be stopped."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from soter.adapters.mavlink.backend import VehicleBackend
from soter.config import load_mission
from soter.runner import Follower, run_mission
from soter.runner.remote_host import RemoteMissionHost
from tests.project.source import ROOT

BACKENDS = [
    ("soter_zmq.adapter:ZmqBackend", "soter_zmq.robot"),
    ("mavlink", "soter_sim.mavlink"),
    ("zenoh", "soter_sim.zenoh"),
    ("zenoh", "soter.adapters.zenoh.mux"),
    pytest.param("ros2", "soter_sim.ros2", marks=pytest.mark.rclpy),
]


@pytest.mark.parametrize(("backend", "module"), BACKENDS)
def test_a_simulator_that_dies_fails_the_run_at_once(backend: str, module: str) -> None:
    overrides: dict[str, Any] = {"backend": backend, "planner": "straight-line", "duration_s": 30.0, "robots": 1}
    ticks = iter(range(10**6))

    def stop() -> bool:
        if next(ticks) == 5:
            os.kill(process_of(module), signal.SIGKILL)
        return False

    result = run_mission(
        load_mission(ROOT / "examples" / "surveillance.toml", overrides), follower=Follower(stop=stop)
    ).result
    assert result.status == "failed"
    assert "has ended with signal SIGKILL" in result.failure
    assert result.duration_s < 2.0


def process_of(module: str) -> int:
    """A process of this one's that runs a module."""
    for children in Path("/proc/self/task").glob("*/children"):
        for pid in children.read_text().split():
            if module in Path(f"/proc/{pid}/cmdline").read_text():
                return int(pid)
    raise AssertionError(f"nothing runs {module}")


def test_waiting_for_the_missions_process_can_be_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    waits = []

    @contextmanager
    def connecting() -> Iterator[None]:
        waits.append(True)
        yield
        waits.clear()

    def ready(_host: RemoteMissionHost) -> None:
        assert waits
        raise KeyboardInterrupt

    monkeypatch.setattr(RemoteMissionHost, "ready", ready)
    mission = load_mission(ROOT / "examples" / "surveillance.toml", {"backend": "mavlink", "planner": "straight-line"})
    with pytest.raises(KeyboardInterrupt):
        run_mission(mission, follower=Follower(connecting=connecting))


@pytest.mark.parametrize(
    "step", ["soter.config.MissionFile.read_workspace", "soter.runner.run.promises", "soter.runner.run.admitted"]
)
def test_what_comes_before_a_run_can_be_interrupted_and_nothing_was_opened_by_then(
    step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    unasked = []

    @contextmanager
    def connecting() -> Iterator[None]:
        unasked.append(True)
        yield
        unasked.clear()

    def under_way(*_: object, **__: object) -> None:
        assert unasked
        raise KeyboardInterrupt

    def opened(*_: object) -> None:
        raise AssertionError("a backend was opened")

    monkeypatch.setattr(step, under_way)
    monkeypatch.setattr(VehicleBackend, "open", opened)
    mission = load_mission(ROOT / "examples" / "surveillance.toml", {"backend": "mavlink", "planner": "straight-line"})
    with pytest.raises(KeyboardInterrupt):
        run_mission(mission, follower=Follower(connecting=connecting))

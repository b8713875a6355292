"""What the command line is tested with: a harness of an adapter that fails, and a wire backend without a harness."""

from __future__ import annotations

from soter.adapters.pybullet import KinematicBackend
from tests.broken.in_process import NoOpStop
from tests.conformance.wire import SimulatedHarness, WireRobot


class FailingHarness(SimulatedHarness):
    def __init__(self) -> None:
        super().__init__(NoOpStop)


class WireBackend(KinematicBackend):
    robot_class = WireRobot  # type: ignore[assignment] # `open` below makes them

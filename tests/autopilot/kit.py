"""A harness of the conformance kit for real autopilots, which go on from one clause to the next.

Pairs of vehicles are started elsewhere. Each process that tries clauses takes a pair that no other one has.
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.backend import MavlinkBackend
from soter.adapters.mavlink.harness import MavlinkHarness, MavlinkRelay
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.vehicle import ARDUBOAT, ARDUCOPTER, ARDUROVER
from soter.cli.given import read_given
from soter.conformance.given import GivenHarness
from soter.sdk import Fleet, RobotSpec

GIVEN: Final = "SOTER_AUTOPILOTS"
"""The environment variable with what was started, as JSON: mission, room_m, and pairs of connection, truth and lock."""

_STATION: Final = 250
_FREE_S: Final = 30.0
_MORE: Final = ("choosing", "seize")


class PairHarness(GivenHarness):
    """Connects to two running vehicles, behind a relay."""

    side_by_side = True
    robots_most = 2

    def __init__(self) -> None:
        told = json.loads(os.environ[GIVEN])
        pair = _taken(told["pairs"])
        settings = [f"backends.mavlink.{key}={pair[key]}" for key in ("connection", "truth")]
        first, second = (read_given(Path(told["mission"]), None, settings, each, told["room_m"]) for each in (1, 2))
        super().__init__(first, MavlinkHarness.between)
        assert isinstance(first.config, MavlinkConfig)
        self.name = f"mavlink, two ArduPilots ({first.config.vehicle})"
        self._stop: Final = {each.name: each.stop for each in (ARDUROVER, ARDUBOAT, ARDUCOPTER)}[first.config.vehicle]
        self._specs: Final = (first.spec, second.spec)

    def open(self, robots: int) -> Fleet:
        return self._opened(self._specs[:robots])

    def choosing(self, order: Sequence[int]) -> Fleet:
        return self._opened([self._specs[each] for each in order])

    def seize(self, robot_id: int) -> None:
        """Have another ground station set the mode in which the vehicle stands."""
        assert isinstance(self.relay, MavlinkRelay)
        self.relay.tell(mav.MAVLink_command_long_message(
            robot_id, mav.MAV_COMP_ID_AUTOPILOT1, mav.MAV_CMD_DO_SET_MODE, 0,
            mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, self._stop, 0.0, 0.0, 0.0, 0.0, 0.0,
        ), _STATION)  # fmt: skip

    def gives(self, hook: str) -> bool:
        return hook in _MORE or super().gives(hook)

    def _opened(self, specs: Sequence[RobotSpec]) -> Fleet:
        config = self._reached().config
        assert isinstance(config, MavlinkConfig)
        self.fleet = fleet = MavlinkBackend().open(config, specs)
        return fleet


def _taken(pairs: Sequence[dict[str, str]]) -> dict[str, str]:
    """Return a pair that no other process has; it is this one's until it ends."""
    until_s = time.monotonic() + _FREE_S
    while time.monotonic() < until_s:
        for pair in pairs:
            lock = os.open(pair["lock"], os.O_CREAT | os.O_RDWR)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(lock)
            else:
                return pair
        time.sleep(0.1)
    raise RuntimeError(f"{len(pairs)} pairs of vehicles were started, and none is free after {_FREE_S:g} s")

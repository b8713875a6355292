"""A robot that the kit did not start: where it is, where it may be driven, and the harness that tries it there."""

from __future__ import annotations

import base64
import pickle
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from soter.clock import VehicleClock
from soter.conformance.relayed import Relay, RelayedHarness
from soter.errors import ConfigError
from soter.geometry.workspace import Workspace
from soter.registry import load_backend
from soter.sdk import BackendConfig, Fleet, RobotSpec, Waypoint
from soter.sdk.truth import StreamedTruth

_CONNECT_S: Final = 90.0
_CLAUSE_S: Final = 900.0
_LEAST_ROOM_M: Final = 2.0
_ROOM_TO_NOISE: Final = 12.0
_BY_RELAY: Final = ("cut", "delay", "loss", "duplicate", "reorder", "garble")


@dataclass(frozen=True)
class Given:
    """One robot of a backend, as a mission file has it.

    Attributes:
        backend: the backend's name.
        config: the backend's options, which lead to the robot.
        spec: the robot; its start is the middle of the room, and its promises are to be judged or improved.
        room_m: the diameter of the free circle around its start.
        judges: whether figures are judged by the promises, or only recorded.
    """

    backend: str
    config: BackendConfig
    spec: RobotSpec
    room_m: float
    judges: bool = True

    @property
    def radius_m(self) -> float:
        """How far the robot may get from its start."""
        return self.room_m / 2.0

    def check(self, workspace: Workspace) -> None:
        """Refuse a room that is not free, before anything moves.

        Raises:
            ConfigError: the room is too small, leaves the workspace or touches a box.
        """
        spec, promised = self.spec, self.spec.promised
        assert promised is not None
        radius_m = self.radius_m + promised.body_radius_m
        # Targets must be far enough apart for the robot to know at which one it is.
        least_m = max(_LEAST_ROOM_M, _ROOM_TO_NOISE * promised.position_noise_m)
        to_fence_m, to_box_m = workspace.fence_m(spec.x_m, spec.y_m), workspace.clearance_m(spec.x_m, spec.y_m, 0.0)
        free_m = min(to_fence_m, to_box_m)
        if self.room_m < least_m or radius_m > free_m:
            what = "the fence" if to_fence_m <= to_box_m else "a box"
            most_m = 2.0 * (free_m - radius_m) + self.room_m
            allowed = f"{least_m:g} to {most_m:.1f}" if most_m >= least_m else "none; start it elsewhere"
            raise ConfigError(
                f"a circle of {self.room_m:g} m and its body take {radius_m:.2f} m around the start of robot "
                f"{spec.id}, ({spec.x_m:g}, {spec.y_m:g}), and {what} is {free_m:.2f} m away; allowed: {allowed}",
                key="--room",
            )

    def promising(self, **figures: Any) -> Given:
        """Return the same robot with other promises."""
        assert self.spec.promised is not None
        return replace(self, spec=replace(self.spec, promised=replace(self.spec.promised, **figures)))


Between = Callable[[Any], tuple[Relay, Any] | None]
"""Takes options that lead to robots; returns a relay to them and options that lead to the relay, or None."""


class GivenHarness(RelayedHarness):
    """Connects to a running robot, which the kit drives back to the middle of its room before each clause.

    Hooks that need the robot to be started are not given; those that break the link only if there can be a relay.
    `start_driver` needs a truth, which sees the robot when its driver is gone.
    """

    charges_at_start = False
    contacts = False
    leg_m = 0.0
    limits = None
    side_by_side = False
    starts_robots = False
    robots_most = 1
    clause_limit_s = _CLAUSE_S
    connect_timeout_s = _CONNECT_S

    def __init__(self, given: Given, between: Between = lambda _: None) -> None:
        super().__init__()
        self.name = f"{given.backend}, robot {given.spec.id}"
        self.room_m = given.room_m
        self.judges = given.judges
        self.speedup = getattr(given.config, "speedup", 1.0)
        self._given: Final = given
        self._between: Final = between
        self._truth: Final[str | None] = getattr(given.config, "truth", None)

    def open(self, robots: int) -> Fleet:
        given = self._reached()
        self.fleet = opened = load_backend(given.backend)().open(given.config, [given.spec])
        return opened

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        assert self._truth is not None
        self.witness = StreamedTruth(self._truth, VehicleClock())
        reached = base64.b64encode(pickle.dumps(self._reached())).decode()
        return self.driven(f"{__name__}:{open_given.__name__}", reached, target)

    def gives(self, hook: str) -> bool:
        if hook in ("start_driver", "observe"):
            return self._truth is not None
        return hook in _BY_RELAY and self._has_relay() and super().gives(hook)

    def _has_relay(self) -> bool:
        if self.relay is not None:
            return True
        made = self._between(self._given.config)
        if made is not None:
            made[0].close()
        return made is not None

    def _reached(self) -> Given:
        """Return the robot with options that lead to it, through a relay if there can be one."""
        made, config = self._between(self._given.config), self._given.config
        if made is not None:
            self.relay, config = made
        return replace(self._given, config=config)


def open_given(argument: str) -> Fleet:
    """Return a fleet of the robot that a pickled `Given` leads to, not initialised; called in the driver's process."""
    given: Given = pickle.loads(base64.b64decode(argument))  # noqa: S301 - from the harness
    return load_backend(given.backend)().open(given.config, [given.spec])

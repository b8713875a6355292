"""Places and active controllers of a run's robots over time, from which a picture of the run is drawn."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from soter.geometry.workspace import Workspace
from soter.rta import BEGINS_S, SwitchRecord
from soter.sdk import Violation


@dataclass(slots=True)
class Track:
    """One robot's way as samples. The arrays are equally long.

    Attributes:
        time_s: fleet time.
        x_m: east.
        y_m: north.
        battery: charge from 0 to 1; NaN where unknown.
        driver: index into `RunTracks.drivers`: 0 is the AC, the others are safety modules.
    """

    time_s: array[float] = field(default_factory=lambda: array("d"))
    x_m: array[float] = field(default_factory=lambda: array("d"))
    y_m: array[float] = field(default_factory=lambda: array("d"))
    battery: array[float] = field(default_factory=lambda: array("d"))
    driver: array[int] = field(default_factory=lambda: array("h"))

    def add(self, time_s: float, x_m: float, y_m: float, battery: float | None, driver: int) -> None:
        """Append a sample; a charge of None is unknown."""
        self.time_s.append(time_s)
        self.x_m.append(x_m)
        self.y_m.append(y_m)
        self.battery.append(math.nan if battery is None else battery)
        self.driver.append(driver)


@dataclass(slots=True)
class RunTracks:
    """The ways of all robots in one run.

    Attributes:
        workspace: fence, boxes, chargers.
        drivers: "AC" and the names of the safety modules.
        tracks: each robot's way, by id.
        switches: every change of control, in order.
        safer_inset_m: how far inside the fence phi_safer of the geofence begins; None without that module.
        violations: every violation by ground truth; empty without it.
        begins: whether robots are starting at first, see `started_s`; not in trials, which judge that time, too.
    """

    workspace: Workspace
    drivers: tuple[str, ...]
    tracks: Mapping[int, Track]
    switches: list[SwitchRecord] = field(default_factory=list)
    safer_inset_m: float | None = None
    violations: tuple[Violation, ...] = ()
    begins: bool = True

    def started_s(self, robot_id: int) -> float:
        """Return until when a robot was starting; 0 if it never was."""
        track = self.tracks[robot_id]
        return started_s(track.time_s, track.driver) if self.begins else 0.0


def started_s(time_s: Sequence[float], driver: Sequence[int]) -> float:
    """Return until when a robot was starting: until its AC, with index 0, first drove, but for `BEGINS_S` at most.

    Every module begins in SC, so that for a while it means nothing that one of them drives.
    """
    if not time_s:
        return 0.0
    first_ac_s = next((time for time, who in zip(time_s, driver, strict=True) if who == 0), math.inf)
    return min(first_ac_s, time_s[0] + BEGINS_S)

"""The vehicle's own fail-safes: no ground station, low battery, outside its fence.

They are off unless they are set, as on ArduPilot.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.channel import Source
from soter_sim.mavlink.fence import AREAS, FENCE
from soter_sim.mavlink.kinds import Mode

_STATION: Final = "GCS"
_BATTERY: Final = "Battery"

_LEVELS: Final = (("BATT_LOW_MAH", "BATT_FS_LOW_ACT"), ("BATT_CRT_MAH", "BATT_FS_CRT_ACT"))
# By whether the vehicle flies, the modes for each action number except 0, which is none; as in ArduPilot.
_ACTIONS: Final = {
    False: {1: [Mode.RTL, Mode.HOLD], 2: [Mode.HOLD]},
    True: {1: [Mode.LAND], 2: [Mode.RTL, Mode.LAND]},
}
_ACTIONS_OF_FENCE: Final = {
    False: {1: [Mode.RTL, Mode.HOLD], 2: [Mode.HOLD]},
    True: {1: [Mode.RTL, Mode.LAND], 2: [Mode.LAND]},
}


class Failsafe:
    """Takes a vehicle over when its ground station is silent, its battery low, or its fence breached.

    It never gives the vehicle back: others have to.

    Args:
        autopilot: the vehicle's autopilot.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._booted_s = autopilot.booted_s
        self._heard_s: float | None = None
        self._battery_level = 0

    def heard(self, by: Source) -> None:
        """Note a heartbeat."""
        if by.system == self._autopilot.parameters["SYSID_MYGCS"]:
            self._heard_s = self._autopilot.now_s

    def look(self) -> None:
        """Check all fail-safes; called once in each period."""
        autopilot = self._autopilot
        if autopilot.booted_s != self._booted_s:
            self._booted_s, self._heard_s, self._battery_level = autopilot.booted_s, None, 0
        if not autopilot.armed:
            # Reset for the next flight.
            autopilot.failed, self._battery_level = None, 0
            return
        self._look_at_station()
        self._look_at_battery()
        self._look_at_fence()

    def _look_at_station(self) -> None:
        autopilot, parameters = self._autopilot, self._autopilot.parameters
        # A ground station that was never heard is not missed.
        if not parameters["FS_GCS_ENABLE"] or self._heard_s is None:
            return
        gone = autopilot.now_s - self._heard_s > parameters["FS_GCS_TIMEOUT"]
        if gone and autopilot.failed != _STATION:
            flies = autopilot.kind.flies
            self._take_over(_STATION, [Mode.RTL, Mode.LAND] if flies else [Mode.HOLD])
        elif not gone and autopilot.failed == _STATION:
            autopilot.failed = None
            autopilot.say(mav.MAV_SEVERITY_INFO, "GCS Failsafe Cleared")

    def _look_at_battery(self) -> None:
        autopilot, parameters = self._autopilot, self._autopilot.parameters
        left_mah = autopilot.sample().charge * parameters["BATT_CAPACITY"]
        for level, (limit, action) in enumerate(_LEVELS, 1):
            if self._battery_level < level and parameters[limit] > 0.0 and left_mah <= parameters[limit]:
                self._battery_level = level
                autopilot.say(mav.MAV_SEVERITY_WARNING, f"Battery 1 is {'critical' if level > 1 else 'low'}")
                modes = _ACTIONS[autopilot.kind.flies].get(int(parameters[action]))
                if modes is not None:
                    self._take_over(_BATTERY, modes)

    def _look_at_fence(self) -> None:
        autopilot, parameters = self._autopilot, self._autopilot.parameters
        if not autopilot.fence.enabled or not int(parameters["FENCE_TYPE"]) & AREAS:
            return
        sample = autopilot.sample()
        left = autopilot.fence.left(sample.x_m, sample.y_m, autopilot.origin)
        if left and autopilot.failed != FENCE:
            modes = _ACTIONS_OF_FENCE[autopilot.kind.flies].get(int(parameters["FENCE_ACTION"]))
            if modes is None:
                autopilot.say(mav.MAV_SEVERITY_WARNING, "Polygon fence breached")
            else:
                self._take_over(FENCE, modes)
        elif not left and autopilot.failed == FENCE:
            autopilot.failed = None

    def _take_over(self, name: str, modes: list[Mode]) -> None:
        autopilot = self._autopilot
        autopilot.failed = name
        autopilot.say(mav.MAV_SEVERITY_WARNING, f"{name} Failsafe")
        # If a mode is refused, try the next one.
        for mode in modes:
            if autopilot.set_mode(mode, f"{name} fail-safe") is None:
                return

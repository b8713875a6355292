"""The parameters of a vehicle: ArduPilot's, and those with the prefix `SOTER_` that this simulation adds."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.kinds import BOAT, Kind
from soter_sim.mavlink.rover import TURN_PER_S


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter.

    Attributes:
        value: initial value.
        least: least value that is allowed.
        most: largest value that is allowed.
        whole: whether only whole numbers are allowed.
    """

    value: float
    least: float = -inf
    most: float = inf
    whole: bool = False

    @property
    def mav_type(self) -> int:
        """Its type in messages."""
        return int(mav.MAV_PARAM_TYPE_INT32 if self.whole else mav.MAV_PARAM_TYPE_REAL32)


def _whole(value: int, least: int, most: int) -> Parameter:
    return Parameter(value, least, most, whole=True)


_COMMON: Final = {
    "ARMING_CHECK": _whole(1, 1, 1),
    "SYSID_MYGCS": _whole(255, 1, 255),
    "FS_GCS_ENABLE": _whole(0, 0, 1),
    "FS_GCS_TIMEOUT": Parameter(5.0, 1.0, 120.0),
    "BATT_CAPACITY": _whole(10_000, 10_000, 10_000),
    "BATT_LOW_MAH": _whole(0, 0, 10_000),
    "BATT_CRT_MAH": _whole(0, 0, 10_000),
    "BATT_FS_LOW_ACT": _whole(0, 0, 2),
    "BATT_FS_CRT_ACT": _whole(0, 0, 2),
    "FENCE_ENABLE": _whole(0, 0, 1),
    "FENCE_ACTION": _whole(2, 0, 2),
    "FENCE_TYPE": _whole(4, 0, 7),
}
_ADDED: Final = {
    "SOTER_LEASE_MS": _whole(250, 50, 5_000),
    "SOTER_YAW_SPEED": _whole(1, 0, 1),
}
_BROKEN: Final = {
    "AHRS_EKF_TYPE": _whole(3, 0, 11),
    "SIM_GPS1_ACC": Parameter(0.3, 0.0, 100.0),
    "SIM_GPS_DISABLE": _whole(0, 0, 1),
    "SIM_WIND_SPD": Parameter(5.0, 0.0, 20.0),
}
_ROVER: Final = {
    "WP_RADIUS": Parameter(0.10, 0.02, 10.0),
    # Two driven wheels, which turn in place.
    "SERVO1_FUNCTION": _whole(73, 73, 73),
    "SERVO3_FUNCTION": _whole(74, 74, 74),
    "WP_PIVOT_ANGLE": _whole(60, 60, 60),
    "ATC_STR_ANG_P": Parameter(TURN_PER_S, TURN_PER_S, TURN_PER_S),
}
_BOAT: Final = {
    "FRAME_CLASS": _whole(2, 2, 2),
    "FS_ACTION": _whole(0, 0, 6),
    "LOIT_RADIUS": Parameter(0.1, 0.0, 100.0),
    "LOIT_TYPE": _whole(0, 0, 0),
    "SIM_TIDE_DIR": Parameter(0.0, 0.0, 360.0),
    "SIM_TIDE_SPD": Parameter(0.05, 0.0, 2.0),
}
_CRUISE_M_S: Final = 0.22
_COPTER: Final = {
    "WPNAV_RADIUS": Parameter(10.0, 2.0, 1_000.0),
    "LAND_SPEED": Parameter(20.0, 5.0, 50.0),
    "RTL_ALT": Parameter(100.0, 20.0, 10_000.0),
    "DISARM_DELAY": _whole(10, 0, 127),
}
_PX4: Final = {"COM_OF_LOSS_T": Parameter(1.0, 0.0, 60.0)}


class Parameters:
    """A vehicle's parameters; they outlive a reboot.

    Args:
        kind: the kind of vehicle, which decides which parameters there are.
        robot_id: the vehicle's number.
        v_max_m_s: top speed of the vehicle.
        plain: without those that this simulation adds to ArduPilot's.
        flawed: with those that inject failures, most of them of ArduPilot's own simulator.
    """

    def __init__(self, kind: Kind, robot_id: int, v_max_m_s: float, *, plain: bool, flawed: bool = False) -> None:
        # Rovers cruise at top speed.
        speed = (
            {"WPNAV_SPEED": Parameter(100.0 * min(v_max_m_s, _CRUISE_M_S), 1.0, 100.0 * v_max_m_s)}
            if kind.flies
            else {"WP_SPEED": Parameter(v_max_m_s, 0.01, v_max_m_s)}
        )
        own = {"SYSID_THISMAV": _whole(robot_id, robot_id, robot_id)} | speed
        known = own | _COMMON | (_COPTER if kind.flies else _ROVER) | (_PX4 if kind.is_px4 else {})
        known |= _BOAT if kind == BOAT else {}
        known |= ({} if plain else _ADDED) | (_BROKEN if flawed else {})
        self.known: Final = dict(sorted(known.items()))
        self.names: Final = tuple(self.known)
        self._values = {name: each.value for name, each in self.known.items()}

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, name: str, value: float) -> str | None:
        """Set a parameter; if the value is not allowed, change nothing and return why."""
        known = self.known[name]
        # Written so that NaN fails too.
        if not known.least <= value <= known.most:
            return f"{name} is {value:g}, allowed: {known.least:g} to {known.most:g}"
        if known.whole and value != int(value):
            return f"{name} is {value:g}, allowed: whole numbers"
        self._values[name] = value
        return None

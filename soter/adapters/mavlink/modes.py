"""Modes by kind of vehicle: the same number means HOLD on one and GUIDED on another, and PX4 packs two into one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.errors import RobotUnavailable

_ROVERS: Final = frozenset({mav.MAV_TYPE_GROUND_ROVER, mav.MAV_TYPE_SURFACE_BOAT})
_COPTERS: Final = frozenset({
    mav.MAV_TYPE_QUADROTOR, mav.MAV_TYPE_COAXIAL, mav.MAV_TYPE_HELICOPTER, mav.MAV_TYPE_HEXAROTOR,
    mav.MAV_TYPE_OCTOROTOR, mav.MAV_TYPE_TRICOPTER, mav.MAV_TYPE_DODECAROTOR,
})  # fmt: skip


def px4_mode(main: int, sub: int = 0) -> int:
    """Return PX4's `custom_mode` for a main mode and a sub mode."""
    return main << 16 | sub << 24


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of vehicle, as far as commanding it goes.

    Attributes:
        name: "rover" or "copter", as the configuration has it.
        autopilot: of HEARTBEAT.
        flies: it has to take off first, and has a height.
        guided: the mode in which it takes targets.
        stop: the mode in which it stands, or hovers, whatever came before.
        land: the mode in which it lands; None on the ground.
        names: what modes are called, for messages to people.
    """

    name: str
    autopilot: int
    flies: bool
    guided: int
    stop: int
    land: int | None
    names: Mapping[int, str]

    @property
    def is_px4(self) -> bool:
        """Whether modes are packed, and targets are taken only while they keep coming."""
        return self.autopilot == int(mav.MAV_AUTOPILOT_PX4)

    def mode_name(self, mode: int) -> str:
        """Return what people call a mode."""
        return self.names.get(mode, f"mode {mode}")

    def mode_params(self, mode: int) -> tuple[float, float, float]:
        """Return the parameters of MAV_CMD_DO_SET_MODE for a mode."""
        flag = float(mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        if self.is_px4:
            return flag, float(mode >> 16 & 0xFF), float(mode >> 24 & 0xFF)
        return flag, float(mode), 0.0


_ARDUROVER: Final = Kind(
    "rover", mav.MAV_AUTOPILOT_ARDUPILOTMEGA, flies=False, guided=15, stop=4, land=None,
    names={0: "MANUAL", 3: "STEERING", 4: "HOLD", 5: "LOITER", 10: "AUTO", 11: "RTL", 15: "GUIDED"},
)  # fmt: skip
_ARDUCOPTER: Final = Kind(
    "copter", mav.MAV_AUTOPILOT_ARDUPILOTMEGA, flies=True, guided=4, stop=17, land=9,
    names={0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND", 17: "BRAKE"},
)  # fmt: skip
_PX4_NAMES: Final = {
    px4_mode(1): "MANUAL", px4_mode(3): "POSCTL", px4_mode(4, 3): "HOLD", px4_mode(4, 4): "MISSION",
    px4_mode(4, 5): "RETURN", px4_mode(4, 6): "LAND", px4_mode(6): "OFFBOARD",
}  # fmt: skip
_PX4_ROVER: Final = Kind(
    "rover", mav.MAV_AUTOPILOT_PX4, flies=False, guided=px4_mode(6), stop=px4_mode(4, 3), land=None, names=_PX4_NAMES
)
_PX4_COPTER: Final = Kind(
    "copter", mav.MAV_AUTOPILOT_PX4, flies=True, guided=px4_mode(6), stop=px4_mode(4, 3), land=px4_mode(4, 6),
    names=_PX4_NAMES,
)  # fmt: skip
_KINDS: Final = {
    (kind.name, kind.autopilot): kind for kind in (_ARDUROVER, _ARDUCOPTER, _PX4_ROVER, _PX4_COPTER)
}  # fmt: skip


def kind_of(vehicle_type: int, autopilot: int) -> Kind:
    """Return the kind of vehicle that a HEARTBEAT tells of.

    Raises:
        RobotUnavailable: it is one that this adapter cannot command.
    """
    name = "rover" if vehicle_type in _ROVERS else "copter" if vehicle_type in _COPTERS else ""
    kind = _KINDS.get((name, autopilot))
    if kind is None:
        raise RobotUnavailable(
            f"it is a vehicle of MAV_TYPE {vehicle_type} with MAV_AUTOPILOT {autopilot}; this adapter commands rovers, "
            "boats and multicopters with ArduPilot or PX4"
        )
    return kind

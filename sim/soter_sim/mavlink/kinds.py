"""The kinds of vehicle: their modes, with ArduPilot's numbers, and their other differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav


class Mode(Enum):
    """A flight mode."""

    MANUAL = "MANUAL"
    STABILIZE = "STABILIZE"
    HOLD = "HOLD"
    LOITER = "LOITER"
    BRAKE = "BRAKE"
    GUIDED = "GUIDED"
    AUTO = "AUTO"
    RTL = "RTL"
    LAND = "LAND"


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of vehicle.

    Attributes:
        name: its name on the command line.
        mav_type: its type in HEARTBEAT.
        autopilot: its autopilot there.
        flies: whether it takes off and lands; else it stays on the ground.
        numbers: its modes' numbers in messages.
        first: the mode after power-on.
        stop: the mode in which it stands, or hovers.
        stops: the modes that every sender may set at any time, because they stop it.
        armable: the modes in which it may be armed.
        streams_hz: the messages that it sends unasked, and how often.
    """

    name: str
    mav_type: int
    autopilot: int
    flies: bool
    numbers: Mapping[Mode, int]
    first: Mode
    stop: Mode
    stops: frozenset[Mode]
    armable: frozenset[Mode]
    streams_hz: Mapping[int, float]

    @property
    def is_px4(self) -> bool:
        """Whether modes are packed, and targets are taken only while they keep coming."""
        return self.autopilot == int(mav.MAV_AUTOPILOT_PX4)

    def mode(self, number: int) -> Mode | None:
        """Return the mode with this number, or None."""
        return next((mode for mode, each in self.numbers.items() if each == number), None)


_UNASKED: Final = (
    mav.MAVLINK_MSG_ID_SYS_STATUS,
    mav.MAVLINK_MSG_ID_SYSTEM_TIME,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT,
    mav.MAVLINK_MSG_ID_ATTITUDE,
    mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    mav.MAVLINK_MSG_ID_MISSION_CURRENT,
    mav.MAVLINK_MSG_ID_VFR_HUD,
    mav.MAVLINK_MSG_ID_BATTERY_STATUS,
    mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
)

ROVER: Final = Kind(
    name="rover",
    mav_type=mav.MAV_TYPE_GROUND_ROVER,
    autopilot=mav.MAV_AUTOPILOT_ARDUPILOTMEGA,
    flies=False,
    numbers={Mode.MANUAL: 0, Mode.HOLD: 4, Mode.AUTO: 10, Mode.RTL: 11, Mode.GUIDED: 15},
    first=Mode.MANUAL,
    stop=Mode.HOLD,
    stops=frozenset({Mode.HOLD}),
    armable=frozenset({Mode.MANUAL, Mode.HOLD, Mode.AUTO, Mode.GUIDED}),
    streams_hz={mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0} | dict.fromkeys(_UNASKED, 1.0),
)
"""A ground robot; without a pilot it stands in MANUAL."""

BOAT: Final = replace(
    ROVER,
    name="boat",
    mav_type=mav.MAV_TYPE_SURFACE_BOAT,
    numbers={**ROVER.numbers, Mode.LOITER: 5},
    stop=Mode.LOITER,
    stops=frozenset({Mode.HOLD, Mode.LOITER}),
    armable=ROVER.armable | {Mode.LOITER},
)
"""A boat, which drifts in all modes but GUIDED and LOITER where it is not driven."""

COPTER: Final = Kind(
    name="copter",
    mav_type=mav.MAV_TYPE_QUADROTOR,
    autopilot=mav.MAV_AUTOPILOT_ARDUPILOTMEGA,
    flies=True,
    numbers={
        Mode.STABILIZE: 0, Mode.AUTO: 3, Mode.GUIDED: 4, Mode.LOITER: 5, Mode.RTL: 6, Mode.LAND: 9, Mode.BRAKE: 17,
    },
    first=Mode.STABILIZE,
    stop=Mode.BRAKE,
    stops=frozenset({Mode.BRAKE, Mode.LOITER, Mode.LAND}),
    armable=frozenset({Mode.STABILIZE, Mode.LOITER, Mode.GUIDED}),
    streams_hz={mav.MAVLINK_MSG_ID_HEARTBEAT: 1.0},
)  # fmt: skip
"""A multicopter; without a pilot it hovers in STABILIZE and LOITER, or stays on the ground."""


def packed(main: float, sub: float = 0.0) -> int:
    """Return PX4's number of a main mode and a sub mode."""
    return int(main) << 16 | int(sub) << 24


PX4_COPTER: Final = replace(
    COPTER,
    autopilot=mav.MAV_AUTOPILOT_PX4,
    numbers={
        Mode.STABILIZE: packed(7), Mode.LOITER: packed(4, 3), Mode.AUTO: packed(4, 4), Mode.RTL: packed(4, 5),
        Mode.LAND: packed(4, 6), Mode.GUIDED: packed(6),
    },
    first=Mode.LOITER,
    stop=Mode.LOITER,
    stops=frozenset({Mode.LOITER, Mode.LAND}),
)  # fmt: skip
"""A multicopter of PX4, which calls LOITER HOLD, and GUIDED OFFBOARD."""

KINDS: Final = {kind.name: kind for kind in (ROVER, COPTER)}

"""Carries out MAV_CMD_* commands, and returns their results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.channel import Channel, Source
from soter_sim.mavlink.frames import turned_rad
from soter_sim.mavlink.kinds import Mode, packed
from soter_sim.mavlink.mission import MOST_ITEMS
from soter_sim.mavlink.setpoint import Place
from soter_sim.mavlink.targets import NotATarget, global_place
from soter_sim.mavlink.telemetry import BUILDERS

ACCEPTED: Final[int] = mav.MAV_RESULT_ACCEPTED
TEMPORARILY_REJECTED: Final[int] = mav.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: Final[int] = mav.MAV_RESULT_DENIED
UNSUPPORTED: Final[int] = mav.MAV_RESULT_UNSUPPORTED
FAILED: Final[int] = mav.MAV_RESULT_FAILED

_ROUNDING_HZ: Final = 1e-6
_REBOOT: Final = 1.0
_REBOOT_BOOTLOADER: Final = 3.0
_FORCED: Final = 20190226.0
"""ArduPilot's word, as the sixth parameter, for a reboot although the vehicle is armed."""
_HIGHEST_M: Final = 1000.0
# Largest interval in MESSAGE_INTERVAL.
_INTERVAL_MOST_US: Final = 2.0**31 - 1.0


class Command(NamedTuple):
    """A received command.

    Attributes:
        number: its MAV_CMD.
        by: its sender.
        channel: the channel that it came over.
        params: its first four parameters.
        x: the fifth parameter; in a COMMAND_INT a latitude in 1e-7 degrees, or the command's own whole number.
        y: the sixth parameter; in a COMMAND_INT a longitude in 1e-7 degrees, or the command's own whole number.
        z: the seventh parameter.
        frame: frame of a COMMAND_INT's place; None for a COMMAND_LONG.
    """

    number: int
    by: Source
    channel: Channel
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    frame: int | None


Handler = Callable[[Autopilot, Command, float], int]
"""Carries out a command and returns its MAV_RESULT; the last argument is the highest rate of a message, in Hz."""


def carry_out(autopilot: Autopilot, command: Command, most_hz: float) -> int:
    """Carry out a command if its sender may give it; return its MAV_RESULT."""
    handler = _HARMLESS.get(command.number)
    if handler is None:
        handler = _HANDLERS.get(command.number)
        if handler is None:
            return UNSUPPORTED
        if not may_command(autopilot, command.by, stops=_stops(autopilot, command)):
            return DENIED
    return handler(autopilot, command, most_hz)


def may_command(autopilot: Autopilot, by: Source, *, stops: bool = False) -> bool:
    """Return whether a sender may give commands that move or change the vehicle; broadcast a warning if not.

    Args:
        autopilot: the vehicle's autopilot.
        by: the sender.
        stops: whether the command only stops the vehicle.
    """
    if autopilot.guided.may_command(by, autopilot.now_s, stops=stops):
        return True
    autopilot.say(mav.MAV_SEVERITY_WARNING, f"Denied: {by} is not in command")
    return False


# --- modes, arming -----------------------------------------------------------------------------------------


def set_mode(autopilot: Autopilot, number: int, reason: str) -> int:
    """Change to the mode with this number; return the MAV_RESULT."""
    mode = autopilot.kind.mode(number)
    if mode is None:
        autopilot.say(mav.MAV_SEVERITY_WARNING, f"No such mode {number}")
        return FAILED
    return FAILED if autopilot.set_mode(mode, reason) else ACCEPTED


def _do_set_mode(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    base, number = command.params[0], _mode_number(autopilot, command)
    if not isfinite(base) or not int(base) & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED or number is None:
        return DENIED
    return set_mode(autopilot, number, f"asked for by {command.by}")


def _mode_number(autopilot: Autopilot, command: Command) -> int | None:
    """Return the mode of a DO_SET_MODE, of which PX4 has a main and a sub mode; None if it is no whole number."""
    main, sub = command.params[1], command.params[2] if autopilot.kind.is_px4 else 0.0
    if not (isfinite(main) and isfinite(sub)) or main != int(main):
        return None
    return packed(main, sub) if autopilot.kind.is_px4 else int(main)


def _arm(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    if command.params[0] == 1.0:
        return FAILED if autopilot.arm() else ACCEPTED
    if command.params[0] == 0.0:
        return FAILED if autopilot.disarm() else ACCEPTED
    return UNSUPPORTED


def _to_mode(mode: Mode) -> Handler:
    def handler(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
        if mode not in autopilot.kind.numbers:
            return UNSUPPORTED
        return FAILED if autopilot.set_mode(mode, f"asked for by {command.by}") else ACCEPTED

    return handler


def _reboot(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    if command.params[0] not in (_REBOOT, _REBOOT_BOOTLOADER):
        return UNSUPPORTED
    return FAILED if autopilot.reboot(forced=command.y == _FORCED) else ACCEPTED


# --- going somewhere ---------------------------------------------------------------------------------------


def _guided_master(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    if autopilot.plain:
        return UNSUPPORTED
    guided, now_s = autopilot.guided, autopilot.now_s
    system, component = command.params[:2]
    # Written so that NaN fails too.
    if not (0.0 <= system <= 255.0 and 0.0 <= component <= 255.0 and isfinite(command.x)):
        return DENIED
    if not guided.may_keep(command.by, now_s):
        autopilot.say(mav.MAV_SEVERITY_WARNING, f"Denied: {command.by} is not in command")
        return DENIED
    since_s = now_s if command.x <= 0.0 else min(now_s, command.x / 1000.0)
    lease_s = autopilot.parameters["SOTER_LEASE_MS"] / 1000.0
    taken = guided.name(command.by, Source(int(system), int(component)), lease_s, since_s)
    return ACCEPTED if taken else TEMPORARILY_REJECTED


def _reposition(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    speed_m_s, flags, _, yaw_rad = command.params
    if command.frame is None:
        return UNSUPPORTED
    if not isfinite(flags):
        return DENIED
    try:
        x_m, y_m, z_m = global_place(autopilot, command.frame, command.x, command.y, command.z)
    except NotATarget as failure:
        autopilot.say(mav.MAV_SEVERITY_WARNING, f"Ignored a target: {failure}")
        return DENIED
    grounded = autopilot.kind.flies and autopilot.landed
    if not autopilot.armed or grounded or not autopilot.guided.may_go(command.by):
        return DENIED
    if autopilot.mode is not Mode.GUIDED and (
        not int(flags) & mav.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        or autopilot.set_mode(Mode.GUIDED, f"asked for by {command.by}")
    ):
        return DENIED
    flies = autopilot.kind.flies
    # NaN means any yaw; a rover takes no yaw at all.
    north_rad = autopilot.reckoning.north_rad(x_m, y_m)
    heading_rad = turned_rad(yaw_rad - north_rad) if flies and isfinite(yaw_rad) else None
    speed_m_s = min(speed_m_s, autopilot.cruise_m_s) if speed_m_s > 0.0 else autopilot.cruise_m_s
    autopilot.guided.put(Place(x_m, y_m, z_m if flies else 0.0, heading_rad, speed_m_s), autopilot.now_s)
    return ACCEPTED


def _take_off(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    if not autopilot.kind.flies or autopilot.kind.is_px4:
        return UNSUPPORTED
    if not 0.0 < command.z <= _HIGHEST_M:
        return DENIED
    if not autopilot.armed or autopilot.mode is not Mode.GUIDED or not autopilot.landed:
        return FAILED
    if not autopilot.guided.may_go(command.by):
        return DENIED
    at = autopilot.sample()
    autopilot.guided.put(Place(at.x_m, at.y_m, at.z_m + command.z, None, autopilot.cruise_m_s), autopilot.now_s)
    return ACCEPTED


_SLOWEST_M_S: Final = 0.05
"""Least speed that ArduRover accepts; at less it keeps its speed."""


def _change_speed(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    speed_m_s = command.params[1]
    if not isfinite(speed_m_s) or speed_m_s == 0.0:
        return DENIED
    if not autopilot.kind.flies and 0.0 < speed_m_s < _SLOWEST_M_S:
        return FAILED
    # -1 means no change, -2 the default speed.
    if speed_m_s != -1.0:
        autopilot.set_speed(speed_m_s if speed_m_s > 0.0 else None)
    return ACCEPTED


def _set_reverse(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    if autopilot.kind.flies:
        return UNSUPPORTED
    autopilot.backwards = command.params[0] == 1.0
    return ACCEPTED


def _set_mission_current(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    seq = command.params[0]
    # Written so that NaN fails too.
    if not 0.0 <= seq <= MOST_ITEMS or not autopilot.mission.go_to(int(seq)):
        return FAILED
    return ACCEPTED


def _set_home(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    at = autopilot.sample()
    if command.params[0] == 1.0:
        autopilot.home = at.x_m, at.y_m, at.z_m
        return ACCEPTED
    if command.frame is None:
        return UNSUPPORTED
    try:
        autopilot.home = global_place(autopilot, command.frame, command.x, command.y, command.z)
    except NotATarget:
        return DENIED
    return ACCEPTED


def _enable_fence(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    if command.params[0] not in (0.0, 1.0):
        return FAILED
    autopilot.fence.enabled = bool(command.params[0])
    return ACCEPTED


# --- messages ----------------------------------------------------------------------------------------------


def _set_interval(autopilot: Autopilot, command: Command, most_hz: float) -> int:
    number, interval_us = command.params[:2]
    if number not in BUILDERS:
        return FAILED
    # Written so that NaN fails too.
    if not -1.0 <= interval_us <= _INTERVAL_MOST_US:
        return DENIED
    streams = command.channel.streams[autopilot.id]
    message_id = int(number)
    if interval_us == -1.0:
        streams.set(message_id, None)
    elif interval_us == 0.0:
        usual_hz = autopilot.kind.streams_hz.get(message_id)
        streams.set(message_id, None if usual_hz is None else 1.0 / usual_hz)
    elif 1e6 / interval_us > most_hz + _ROUNDING_HZ:
        return DENIED
    else:
        streams.set(message_id, interval_us / 1e6)
    return ACCEPTED


def _get_interval(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    return _send_interval(autopilot, command, command.params[0])


def _send_interval(autopilot: Autopilot, command: Command, number: float) -> int:
    if number not in BUILDERS:
        return FAILED
    period_s = command.channel.streams[autopilot.id].period_s.get(int(number))
    interval_us = -1 if period_s is None else round(1e6 * period_s)
    command.channel.send(autopilot.id, mav.MAVLink_message_interval_message(int(number), interval_us))
    return ACCEPTED


def _request(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
    number = command.params[0]
    if number == mav.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
        return _send_interval(autopilot, command, command.params[1])
    return _send(autopilot, command, number)


def _send_one(message_id: int) -> Handler:
    def handler(autopilot: Autopilot, command: Command, _most_hz: float) -> int:
        return _send(autopilot, command, message_id)

    return handler


def _send(autopilot: Autopilot, command: Command, number: float) -> int:
    build = BUILDERS.get(int(number)) if isfinite(number) else None
    message = None if build is None else build(autopilot)
    if message is None:
        return FAILED
    command.channel.send(autopilot.id, message)
    return ACCEPTED


def _stops(autopilot: Autopilot, command: Command) -> bool:
    """Return whether a command only stops the vehicle, so that any sender may give it."""
    number, params = command.number, command.params
    if number == mav.MAV_CMD_DO_SET_MODE:
        mode_number = _mode_number(autopilot, command)
        return any(mode_number == autopilot.kind.numbers[mode] for mode in autopilot.kind.stops)
    return number == mav.MAV_CMD_NAV_LAND or (number == mav.MAV_CMD_COMPONENT_ARM_DISARM and params[0] == 0.0)


_HARMLESS: Final[Mapping[int, Handler]] = {
    mav.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    mav.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
    mav.MAV_CMD_REQUEST_MESSAGE: _request,
    mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _send_one(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    mav.MAV_CMD_GET_HOME_POSITION: _send_one(mav.MAVLINK_MSG_ID_HOME_POSITION),
    # This command has a rule of its own.
    mav.MAV_CMD_DO_GUIDED_MASTER: _guided_master,
}
_HANDLERS: Final[Mapping[int, Handler]] = {
    mav.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    mav.MAV_CMD_DO_SET_MODE: _do_set_mode,
    mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: _to_mode(Mode.RTL),
    mav.MAV_CMD_NAV_LAND: _to_mode(Mode.LAND),
    mav.MAV_CMD_MISSION_START: _to_mode(Mode.AUTO),
    mav.MAV_CMD_NAV_TAKEOFF: _take_off,
    mav.MAV_CMD_DO_REPOSITION: _reposition,
    mav.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    mav.MAV_CMD_DO_SET_REVERSE: _set_reverse,
    mav.MAV_CMD_DO_SET_MISSION_CURRENT: _set_mission_current,
    mav.MAV_CMD_DO_SET_HOME: _set_home,
    mav.MAV_CMD_DO_FENCE_ENABLE: _enable_fence,
    mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
}

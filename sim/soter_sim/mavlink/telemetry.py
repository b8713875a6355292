"""The telemetry of a vehicle: one function for each message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, degrees, hypot, nan, sin
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.fence import FENCE
from soter_sim.mavlink.frames import turned, turned_rad
from soter_sim.mavlink.kinds import Mode
from soter_sim.mavlink.route import Touring
from soter_sim.mavlink.setpoint import Place, Velocity

Message = mav.MAVLink_message
Build = Callable[[Autopilot], Message | None]
"""Makes a message; None while the vehicle does not know its content."""

EKF_READY: Final = 831
EKF_NOT_READY: Final = 167

CAPABILITIES: Final[int] = (
    mav.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | mav.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mav.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mav.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
_VERSION: Final = (4 << 24) | (6 << 16) | (0 << 8) | 255

# Before the EKF has settled, heights are wrong by this much.
_UNSETTLED_M: Final = 584.0
_CELLS_MV: Final = 3 * 4200
_NO_CELL: Final = 0xFFFF
_POSITION_ONLY: Final = 0x0DF8
_VELOCITY_ONLY: Final = 0x0DC7
_SENSORS: Final[int] = (
    mav.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mav.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mav.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mav.MAV_SYS_STATUS_SENSOR_GPS
    | mav.MAV_SYS_STATUS_AHRS
    | mav.MAV_SYS_STATUS_SENSOR_BATTERY
    | mav.MAV_SYS_STATUS_PREARM_CHECK
)


def heartbeat(autopilot: Autopilot) -> Message:
    """Return HEARTBEAT."""
    base = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    if autopilot.mode in (Mode.GUIDED, Mode.AUTO, Mode.RTL, Mode.LAND, Mode.BRAKE, Mode.LOITER):
        base |= mav.MAV_MODE_FLAG_GUIDED_ENABLED | mav.MAV_MODE_FLAG_STABILIZE_ENABLED
    else:
        base |= mav.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    if autopilot.armed:
        base |= mav.MAV_MODE_FLAG_SAFETY_ARMED
    if not autopilot.fixed:
        status = mav.MAV_STATE_CALIBRATING
    elif autopilot.failed is not None:
        status = mav.MAV_STATE_CRITICAL
    else:
        status = mav.MAV_STATE_ACTIVE if autopilot.armed else mav.MAV_STATE_STANDBY
    kind = autopilot.kind
    return mav.MAVLink_heartbeat_message(kind.mav_type, kind.autopilot, base, kind.numbers[autopilot.mode], status, 3)


def local_position_ned(autopilot: Autopilot) -> Message | None:
    """Return LOCAL_POSITION_NED, from the origin of the EKF."""
    if not autopilot.fixed:
        return None
    at = autopilot.said()
    return mav.MAVLink_local_position_ned_message(
        autopilot.boot_ms, at.y_m, at.x_m, _height_m(autopilot), at.north_m_s, at.east_m_s, -at.up_m_s
    )


def global_position_int(autopilot: Autopilot) -> Message | None:
    """Return GLOBAL_POSITION_INT."""
    if not autopilot.fixed:
        return None
    at, origin, said = autopilot.sample(), autopilot.origin, autopilot.said()
    lat_e7, lon_e7 = origin.geodetic_e7(at.x_m, at.y_m)
    home_m = 0.0 if autopilot.home is None else autopilot.home[2]
    up_m = -_height_m(autopilot)
    return mav.MAVLink_global_position_int_message(
        autopilot.boot_ms, lat_e7, lon_e7, round(1000.0 * (origin.alt_m + up_m)), round(1000.0 * (up_m - home_m)),
        round(100.0 * said.north_m_s), round(100.0 * said.east_m_s), round(-100.0 * at.up_m_s),
        round(100.0 * degrees(turned_rad(said.heading_rad))) % 36000,
    )  # fmt: skip


def attitude(autopilot: Autopilot) -> Message:
    """Return ATTITUDE."""
    at = autopilot.said()
    return mav.MAVLink_attitude_message(
        autopilot.boot_ms, 0.0, 0.0, turned_rad(at.heading_rad), 0.0, 0.0, -at.yaw_rate_rad_s
    )


def attitude_quaternion(autopilot: Autopilot) -> Message:
    """Return ATTITUDE_QUATERNION."""
    at = autopilot.said()
    half_rad = 0.5 * turned_rad(at.heading_rad)
    return mav.MAVLink_attitude_quaternion_message(
        autopilot.boot_ms, cos(half_rad), 0.0, 0.0, sin(half_rad), 0.0, 0.0, -at.yaw_rate_rad_s
    )


def vfr_hud(autopilot: Autopilot) -> Message:
    """Return VFR_HUD."""
    at = autopilot.said()
    speed_m_s = hypot(at.east_m_s, at.north_m_s)
    heading_deg = round(degrees(turned_rad(at.heading_rad))) % 360
    return mav.MAVLink_vfr_hud_message(
        speed_m_s, speed_m_s, heading_deg, 0, autopilot.origin.alt_m - _height_m(autopilot), at.up_m_s
    )


def gps_raw_int(autopilot: Autopilot) -> Message:
    """Return GPS_RAW_INT."""
    at, origin = autopilot.sample(), autopilot.origin
    if not autopilot.fixed:
        return mav.MAVLink_gps_raw_int_message(
            1000 * autopilot.boot_ms, mav.GPS_FIX_TYPE_NO_FIX, 0, 0, 0, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0
        )
    lat_e7, lon_e7 = origin.geodetic_e7(at.x_m, at.y_m)
    course_cdeg = round(100.0 * degrees(turned_rad(autopilot.said().heading_rad))) % 36000
    return mav.MAVLink_gps_raw_int_message(
        1000 * autopilot.fix_ms, mav.GPS_FIX_TYPE_RTK_FIXED, lat_e7, lon_e7,
        round(1000.0 * (origin.alt_m + at.z_m)), 70, 100,
        round(100.0 * hypot(at.east_m_s, at.north_m_s)), course_cdeg, 14, h_acc=autopilot.gps_accuracy_mm,
    )  # fmt: skip


def sys_status(autopilot: Autopilot) -> Message:
    """Return SYS_STATUS."""
    sensors = _SENSORS
    if autopilot.fence.enabled:
        sensors |= mav.MAV_SYS_STATUS_GEOFENCE
    # Without a fence, none is breached: ground stations check this bit.
    healthy = _SENSORS if autopilot.failed == FENCE else _SENSORS | mav.MAV_SYS_STATUS_GEOFENCE
    if not autopilot.ready:
        healthy &= ~(mav.MAV_SYS_STATUS_AHRS | mav.MAV_SYS_STATUS_PREARM_CHECK)
    charge = autopilot.sample().charge
    return mav.MAVLink_sys_status_message(
        sensors, sensors, healthy, 100, _voltage_mv(charge), -1, int(100.0 * charge), 0, 0, 0, 0, 0, 0
    )


def battery_status(autopilot: Autopilot) -> Message:
    """Return BATTERY_STATUS; the charge consumed is finer than the percentage, and falls while charging."""
    charge = autopilot.sample().charge
    capacity_mah = autopilot.parameters["BATT_CAPACITY"]
    return mav.MAVLink_battery_status_message(
        0, mav.MAV_BATTERY_FUNCTION_ALL, mav.MAV_BATTERY_TYPE_LIPO, 0x7FFF,
        (_voltage_mv(charge), *(_NO_CELL,) * 9), -1, round((1.0 - charge) * capacity_mah), -1, int(100.0 * charge),
    )  # fmt: skip


def ekf_status_report(autopilot: Autopilot) -> Message | None:
    """Return EKF_STATUS_REPORT, which is ArduPilot's."""
    if autopilot.kind.is_px4:
        return None
    ready = autopilot.ready
    variance = 0.01 if ready else 0.9
    return mav.MAVLink_ekf_status_report_message(
        EKF_READY if ready else EKF_NOT_READY, variance, variance, variance, variance, 0.0
    )


def estimator_status(autopilot: Autopilot) -> Message | None:
    """Return ESTIMATOR_STATUS, which is PX4's: on the ground its position is constant, too, and its compass unused."""
    if not autopilot.kind.is_px4:
        return None
    flags = EKF_READY if autopilot.ready else EKF_NOT_READY
    if autopilot.landed:
        flags |= mav.ESTIMATOR_CONST_POS_MODE
    message: Message = mav.MAVLink_estimator_status_message(
        1000 * autopilot.boot_ms, flags, 0.01, 0.01, 0.01, nan, 0.01, 0.0, 0.1, 0.1
    )
    return message


def home_position(autopilot: Autopilot) -> Message | None:
    """Return HOME_POSITION."""
    if autopilot.home is None:
        return None
    x_m, y_m, z_m = autopilot.home
    origin = autopilot.origin
    lat_e7, lon_e7 = origin.geodetic_e7(x_m, y_m)
    east_m, north_m = autopilot.reckoning.local_m(x_m, y_m)
    return mav.MAVLink_home_position_message(
        lat_e7, lon_e7, round(1000.0 * (origin.alt_m + z_m)), north_m, east_m, -z_m, (1.0, 0.0, 0.0, 0.0),
        0.0, 0.0, 0.0, 1000 * autopilot.boot_ms,
    )  # fmt: skip


def gps_global_origin(autopilot: Autopilot) -> Message | None:
    """Return GPS_GLOBAL_ORIGIN."""
    if not autopilot.ready:
        return None
    origin = autopilot.origin
    return mav.MAVLink_gps_global_origin_message(
        *autopilot.reckoning.origin_e7, round(1000.0 * origin.alt_m), 1000 * autopilot.boot_ms
    )


def extended_sys_state(autopilot: Autopilot) -> Message:
    """Return EXTENDED_SYS_STATE."""
    if not autopilot.kind.flies or autopilot.landed:
        state = mav.MAV_LANDED_STATE_ON_GROUND
    elif autopilot.route is not None and autopilot.route.lands:
        state = mav.MAV_LANDED_STATE_LANDING
    else:
        state = mav.MAV_LANDED_STATE_IN_AIR
    return mav.MAVLink_extended_sys_state_message(mav.MAV_VTOL_STATE_UNDEFINED, state)


def system_time(autopilot: Autopilot) -> Message:
    """Return SYSTEM_TIME; the date is unknown."""
    return mav.MAVLink_system_time_message(0, autopilot.boot_ms)


def autopilot_version(autopilot: Autopilot) -> Message:
    """Return AUTOPILOT_VERSION."""
    nothing = (0,) * 8
    return mav.MAVLink_autopilot_version_message(
        CAPABILITIES, _VERSION, 0, 0, 0, nothing, nothing, nothing, 0, 0, autopilot.id
    )


def mission_current(autopilot: Autopilot) -> Message:
    """Return MISSION_CURRENT."""
    mission, route = autopilot.mission, autopilot.route
    total = len(mission.items)
    if not total:
        state = mav.MISSION_STATE_NO_MISSION
    elif isinstance(route, Touring):
        state = mav.MISSION_STATE_COMPLETE if route.done else mav.MISSION_STATE_ACTIVE
    else:
        state = mav.MISSION_STATE_PAUSED if mission.current else mav.MISSION_STATE_NOT_STARTED
    return mav.MAVLink_mission_current_message(
        min(mission.current, total), total, state, 1 if autopilot.mode is Mode.AUTO else 2
    )


def position_target_local_ned(autopilot: Autopilot) -> Message | None:
    """Return POSITION_TARGET_LOCAL_NED: the target in GUIDED, whether or not its lease lives."""
    target, reckoning = autopilot.guided.target(), autopilot.reckoning
    if isinstance(target, Place):
        mask, yaw_rad = _POSITION_ONLY, 0.0
        east_m, north_m = reckoning.local_m(target.x_m, target.y_m)
        if target.heading_rad is not None:
            mask, yaw_rad = (
                mask & ~mav.POSITION_TARGET_TYPEMASK_YAW_IGNORE,
                turned_rad(target.heading_rad - reckoning.north_rad(target.x_m, target.y_m)),
            )
        return mav.MAVLink_position_target_local_ned_message(
            autopilot.boot_ms, mav.MAV_FRAME_LOCAL_NED, mask, north_m, east_m, -target.z_m,
            0.0, 0.0, 0.0, 0.0, 0.0, 0.0, yaw_rad, 0.0,
        )  # fmt: skip
    if isinstance(target, Velocity):
        at = autopilot.sample()
        east_m_s, north_m_s = turned(target.east_m_s, target.north_m_s, -reckoning.north_rad(at.x_m, at.y_m))
        return mav.MAVLink_position_target_local_ned_message(
            autopilot.boot_ms, mav.MAV_FRAME_LOCAL_NED, _VELOCITY_ONLY, 0.0, 0.0, 0.0,
            north_m_s, east_m_s, -target.up_m_s, 0.0, 0.0, 0.0, 0.0, -(target.yaw_rate_rad_s or 0.0),
        )  # fmt: skip
    return None


def position_target_global_int(autopilot: Autopilot) -> Message | None:
    """Return POSITION_TARGET_GLOBAL_INT: the place that it goes to in GUIDED; None for a velocity."""
    target = autopilot.guided.target()
    if not isinstance(target, Place):
        return None
    lat_e7, lon_e7 = autopilot.origin.geodetic_e7(target.x_m, target.y_m)
    message: Message = mav.MAVLink_position_target_global_int_message(
        autopilot.boot_ms, mav.MAV_FRAME_GLOBAL, _POSITION_ONLY, lat_e7, lon_e7, autopilot.origin.alt_m + target.z_m,
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    return message


def guided_master(autopilot: Autopilot) -> Message | None:
    """Return NAMED_VALUE_INT `GMASTER`: 256 x system + component of the master, negative if the lease is dead."""
    if autopilot.plain:
        return None
    guided = autopilot.guided
    value = 256 * guided.master.system + guided.master.component
    return mav.MAVLink_named_value_int_message(
        autopilot.boot_ms, b"GMASTER", value if guided.alive(autopilot.now_s) else -value
    )


BUILDERS: Final[Mapping[int, Build]] = {
    mav.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mav.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mav.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude_quaternion,
    mav.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mav.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    mav.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report,
    mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_status,
    mav.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
    mav.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    mav.MAVLINK_MSG_ID_MISSION_CURRENT: mission_current,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position_target_local_ned,
    mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: position_target_global_int,
    mav.MAVLINK_MSG_ID_NAMED_VALUE_INT: guided_master,
}
"""By message id, the function that makes the message."""


_POSITION_GROUP: Final = (mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
_STATUS_GROUP: Final = (
    mav.MAVLINK_MSG_ID_SYS_STATUS,
    mav.MAVLINK_MSG_ID_GPS_RAW_INT,
    mav.MAVLINK_MSG_ID_MISSION_CURRENT,
)
_ATTITUDE_GROUP: Final = (mav.MAVLINK_MSG_ID_ATTITUDE,)
_HUD_GROUP: Final = (mav.MAVLINK_MSG_ID_VFR_HUD,)
_OTHERS_GROUP: Final = (
    mav.MAVLINK_MSG_ID_SYSTEM_TIME,
    mav.MAVLINK_MSG_ID_BATTERY_STATUS,
    mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
)
GROUPS: Final[Mapping[int, tuple[int, ...]]] = {
    mav.MAV_DATA_STREAM_ALL: (*_POSITION_GROUP, *_STATUS_GROUP, *_ATTITUDE_GROUP, *_HUD_GROUP, *_OTHERS_GROUP),
    mav.MAV_DATA_STREAM_POSITION: _POSITION_GROUP,
    mav.MAV_DATA_STREAM_EXTENDED_STATUS: _STATUS_GROUP,
    mav.MAV_DATA_STREAM_EXTRA1: _ATTITUDE_GROUP,
    mav.MAV_DATA_STREAM_EXTRA2: _HUD_GROUP,
    mav.MAV_DATA_STREAM_EXTRA3: _OTHERS_GROUP,
}
"""The messages in the groups of REQUEST_DATA_STREAM, which older ground stations use."""


def _height_m(autopilot: Autopilot) -> float:
    """Return its estimated height below the origin."""
    return -autopilot.sample().z_m - (0.0 if autopilot.ready else _UNSETTLED_M)


def _voltage_mv(charge: float) -> int:
    return round(_CELLS_MV * (0.8 + 0.2 * charge))

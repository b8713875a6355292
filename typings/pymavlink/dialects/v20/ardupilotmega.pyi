from collections.abc import Callable
from typing import Any, Protocol

class _File(Protocol):
    def write(self, data: bytes, /) -> object: ...

class MAVError(Exception):
    message: str

class MAVLink_message:
    id: int
    def __init__(self, msgId: int, name: str) -> None: ...
    def get_type(self) -> str: ...
    def get_msgId(self) -> int: ...
    def get_srcSystem(self) -> int: ...
    def get_srcComponent(self) -> int: ...
    def get_seq(self) -> int: ...
    def get_signed(self) -> bool: ...
    def get_msgbuf(self) -> bytearray: ...
    def to_dict(self) -> dict[str, Any]: ...
    def pack(self, mav: MAVLink, force_mavlink1: bool = ...) -> bytes: ...
    # The fields of the messages, which have a class each in the dialect.
    def __getattr__(self, name: str) -> Any: ...

class MAVLinkSigning:
    secret_key: bytes | None
    timestamp: int
    stream_timestamps: dict[tuple[int, int, int], int]
    link_id: int
    sign_outgoing: bool
    allow_unsigned_callback: Callable[[MAVLink, int], bool] | None

class MAVLink:
    seq: int
    buf: bytearray
    buf_index: int
    expected_length: int
    robust_parsing: bool
    srcSystem: int
    srcComponent: int
    signing: MAVLinkSigning
    def __init__(
        self, file: _File | None, srcSystem: int = ..., srcComponent: int = ..., use_native: bool = ...
    ) -> None: ...
    def send(self, mavmsg: MAVLink_message, force_mavlink1: bool = ...) -> None: ...
    def buf_len(self) -> int: ...
    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool: ...
    def parse_buffer(self, s: bytes) -> list[MAVLink_message] | None: ...
    # `NAME_encode` and `NAME_send` for each message.
    def __getattr__(self, name: str) -> Any: ...

class EnumEntry:
    name: str
    description: str

class _Fields(MAVLink_message):
    def __init__(self, *fields: Any, **named: Any) -> None: ...

MAVLink_attitude_message = _Fields
MAVLink_attitude_quaternion_message = _Fields
MAVLink_autopilot_version_message = _Fields
MAVLink_battery_status_message = _Fields
MAVLink_command_ack_message = _Fields
MAVLink_command_int_message = _Fields
MAVLink_command_long_message = _Fields
MAVLink_ekf_status_report_message = _Fields
MAVLink_extended_sys_state_message = _Fields
MAVLink_file_transfer_protocol_message = _Fields
MAVLink_global_position_int_message = _Fields
MAVLink_gps_global_origin_message = _Fields
MAVLink_gps_raw_int_message = _Fields
MAVLink_heartbeat_message = _Fields
MAVLink_home_position_message = _Fields
MAVLink_local_position_ned_message = _Fields
MAVLink_message_interval_message = _Fields
MAVLink_mission_ack_message = _Fields
MAVLink_mission_clear_all_message = _Fields
MAVLink_mission_count_message = _Fields
MAVLink_mission_current_message = _Fields
MAVLink_mission_item_message = _Fields
MAVLink_mission_item_int_message = _Fields
MAVLink_mission_item_reached_message = _Fields
MAVLink_mission_request_message = _Fields
MAVLink_mission_request_int_message = _Fields
MAVLink_mission_request_list_message = _Fields
MAVLink_mission_set_current_message = _Fields
MAVLink_named_value_int_message = _Fields
MAVLink_param_request_list_message = _Fields
MAVLink_param_request_read_message = _Fields
MAVLink_param_set_message = _Fields
MAVLink_param_value_message = _Fields
MAVLink_ping_message = _Fields
MAVLink_position_target_local_ned_message = _Fields
MAVLink_set_mode_message = _Fields
MAVLink_set_position_target_global_int_message = _Fields
MAVLink_set_position_target_local_ned_message = _Fields
MAVLink_statustext_message = _Fields
MAVLink_sys_status_message = _Fields
MAVLink_system_time_message = _Fields
MAVLink_timesync_message = _Fields
MAVLink_vfr_hud_message = _Fields

enums: dict[str, dict[int, EnumEntry]]
mavlink_map: dict[int, type[MAVLink_message]]

# The constants, and the classes of further messages.
def __getattr__(name: str) -> Any: ...

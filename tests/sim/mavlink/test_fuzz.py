"""Whatever comes over the wire, the vehicles go on, answer, and stay within what they can do."""

from __future__ import annotations

import math
import random
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.commands import _HANDLERS, _HARMLESS
from soter_sim.mavlink.telemetry import BUILDERS
from tests.sim.mavlink.client import ACCEPTED, Message, Rig

HEARD = (
    "command_long", "command_int", "set_mode", "set_position_target_local_ned", "set_position_target_global_int",
    "heartbeat", "request_data_stream", "param_request_list", "param_request_read", "param_set", "mission_count",
    "mission_item_int", "mission_item", "mission_request_list", "mission_request_int", "mission_request",
    "mission_clear_all", "mission_set_current", "timesync", "ping",
    "file_transfer_protocol",
)  # fmt: skip
COMMANDS = sorted({*_HANDLERS, *_HARMLESS})
FLOATS = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e30, -1.0, 0.0, 1.0, 2.0, 0.5, 15.0, 4.0, 1e-40)
SIZES = {"uint8_t": 8, "uint16_t": 16, "uint32_t": 32, "uint64_t": 64, "int8_t": 7, "int16_t": 15, "int32_t": 31,
         "int64_t": 63}  # fmt: skip


def field(rng: random.Random, kind: str, name: str) -> object:
    """A value of a field, extreme as often as not."""
    if name == "target_system":
        return rng.choice((0, 1, 1, 1, 1))
    if name == "param1" and rng.random() < 0.4:
        return float(rng.choice((*BUILDERS, 1)))
    if name == "command":
        return rng.choice(COMMANDS)
    if name == "payload":
        return rng.randbytes(251)
    if name in ("frame", "coordinate_frame", "seq", "count", "mission_type"):
        return rng.choice((0, 0, 1, 2, 3, 5, 6, 7, 8, 9, 255))
    if name == "type_mask":
        return rng.choice((0, 0x0DF8, 0x0DC7, 0x01C0, 0x0FFF, rng.getrandbits(16)))
    if kind == "char":
        return rng.choice((*(name.encode() for name in ("WP_SPEED", "SOTER_LEASE_MS", "")), rng.randbytes(16)))
    if kind in ("float", "double"):
        return rng.choice(FLOATS) if rng.random() < 0.7 else rng.uniform(-20.0, 20.0)
    size = SIZES[kind]
    signed = kind.startswith("i")
    most = 2**size - 1
    return rng.choice((0, 1, most, -most - 1 if signed else 0, rng.randint(-most if signed else 0, most)))


def made_up(rng: random.Random) -> Message:
    """A message out of nowhere."""
    cls = getattr(mav, f"MAVLink_{rng.choice(HEARD)}_message")
    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    message: Message = cls(*(field(rng, types[name], name) for name in cls.fieldnames))
    return message


@pytest.mark.parametrize("vehicle", ["rover", "copter"])
@pytest.mark.parametrize("seed", range(4))
def test_no_message_harms_a_vehicle(vehicle: str, seed: int) -> None:
    rng = random.Random(f"{vehicle} {seed}")
    with Rig(vehicle=vehicle, boot_s=0.0) as rig:
        rig.guided()
        stranger = rig.connect(245, 191)
        for _ in range(600):
            by = rng.choice((rig.client, stranger))
            try:
                by.send(made_up(rng))
            except (struct.error, OverflowError):
                continue
            if rng.random() < 0.3:
                rig.run(rig.period_s)
            if rng.random() < 0.05:
                by.send(
                    mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
                )
            sample = rig.autopilot.sample()
            assert all(map(math.isfinite, sample))
            assert math.hypot(sample.east_m_s, sample.north_m_s) <= 0.5001
        # Everything that there is can still be asked for.
        for message_id in BUILDERS:
            rig.command(mav.MAV_CMD_REQUEST_MESSAGE, message_id, by=rig.connect(200, 1))
            rig.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, message_id)
        assert rig.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_HEARTBEAT) == ACCEPTED


def test_noise_harms_nobody() -> None:
    rng = random.Random(7)
    with Rig() as rig:
        for _ in range(300):
            rig.client.send_raw(rng.randbytes(rng.randint(1, 300)))
            rig.run(rig.period_s)
        # A stream finds its way back, whatever length the noise pretended to have.
        assert any(rig.mode(4) == ACCEPTED for _ in range(10))

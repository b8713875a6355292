"""Check digits of records that decisions rest on: they tell that a value was changed, which one, and what it was.

Chunks of a recording have checksums of their own, against damage. These digits stand inside of the records, so that
a value that was changed by whatever wrote, converted or edited the file is found as well.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from functools import reduce
from operator import xor
from typing import Final, NamedTuple

from msgspec import UNSET, UnsetType

from soter.record.messages import AC, Peer, RobotTick, State

_ABSENT: Final = math.nan
_CRC_DIGITS: Final = 8
_HEAD: Final = (
    "tick", "time_s", "robot_id", "mode", "driver", "unread", "no_state", "refused", "ac_drove", "ac_failure",
)  # fmt: skip
_STATE: Final = (
    "stamp_s", "x_m", "y_m", "z_m", "heading_rad", "vx_m_s", "vy_m_s", "yaw_rate_rad_s", "link", "vehicle_stamp_s",
    "battery", "controller", "goal_id", "vz_m_s",
)  # fmt: skip
_TEXTS: Final = frozenset({
    "mode", "driver", "no_state", "refused", "ac_failure", "link", "controller", "name", "assumption", "cause",
})  # fmt: skip
_PEER: Final = ("time_s", "robot_id", "needs_charge", "assumption", "cause")


class Flaw(NamedTuple):
    """A record whose check digits do not fit it.

    Attributes:
        time_s: fleet time of the tick.
        robot_id: whose record.
        field: the value that was changed, if it is a single one; else empty.
        reads: what the record says.
        was: what it said when it was written; for a text, only its checksum is known.
    """

    time_s: float
    robot_id: int
    field: str = ""
    reads: str = ""
    was: str = ""


def seal(record: RobotTick | Peer) -> str:
    """Return the check digits of a record: a CRC-32 of all values, and the exclusive or of them."""
    packed = _packed(_values(record))
    return f"{zlib.crc32(packed):0{_CRC_DIGITS}x}{_parity(packed):016x}"


def flaw(record: RobotTick | Peer) -> Flaw | None:
    """Return what is wrong with a record, or None. A record without check digits is wrong too."""
    digits = seal(record)
    if digits == record.check:
        return None
    found = Flaw(record.time_s, record.robot_id)
    try:
        crc, parity = int(record.check[:_CRC_DIGITS], 16), int(record.check[_CRC_DIGITS:], 16)
    except ValueError:
        return found
    if not 0 <= parity < 1 << 64:
        return found
    packed = _packed(_values(record))
    # If one value was changed, the parities differ by just that change; undoing it must give the checksum.
    change = parity ^ _parity(packed)
    words = list(struct.unpack(f"<{len(packed) // 8}Q", packed))
    for index, name in enumerate(_names(record)):
        words[index] ^= change
        mended = struct.pack(f"<{len(words)}Q", *words)
        words[index] ^= change
        if zlib.crc32(mended) == crc:
            reads, was = (struct.unpack_from("<d", data, 8 * index)[0] for data in (packed, mended))
            return found._replace(field=name, reads=_shown(name, reads), was=_shown(name, was))
    return found


def _shown(name: str, value: float) -> str:
    if name.rpartition(".")[2] in _TEXTS:
        return f"a text with checksum {value:.0f}"
    return "absent" if name.startswith("state.") and math.isnan(value) else repr(value)


def _values(record: RobotTick | Peer) -> list[float]:
    if isinstance(record, Peer):
        head = [
            record.time_s, float(record.robot_id), float(record.needs_charge), _text(record.assumption),
            _text(record.cause),
        ]  # fmt: skip
        heard = [value for each in record.heard for value in (float(each.robot_id), each.stamp_s)]
        return head + ([] if record.state is UNSET else _state(record.state)) + heard
    values = [
        float(record.tick), record.time_s, float(record.robot_id), _text(record.mode), _text(record.driver),
        float(record.unread), _text(record.no_state),
        _text("".join(f"{each.call}:{each.failure};" for each in record.refused)),
        float(record.ac_drove), _text(record.ac_failure), *_state(record.state),
    ]  # fmt: skip
    for module in record.modules:
        values += (_text(module.name), _text(module.mode), module.margin_value, module.reach_value)
    return values


def _state(state: State) -> list[float]:
    return [
        state.stamp_s, state.x_m, state.y_m, state.z_m, state.heading_rad, state.vx_m_s, state.vy_m_s,
        state.yaw_rate_rad_s, _text(state.link), _number(state.vehicle_stamp_s), _number(state.battery),
        _text(state.controller), _number(state.goal_id), _number(state.vz_m_s),
    ]  # fmt: skip


def _names(record: RobotTick | Peer) -> Iterator[str]:
    if isinstance(record, Peer):
        yield from _PEER
        if record.state is not UNSET:
            yield from (f"state.{name}" for name in _STATE)
        yield from (f"heard.{name}" for _ in record.heard for name in ("robot_id", "stamp_s"))
        return
    yield from _HEAD
    yield from (f"state.{name}" for name in _STATE)
    for module in record.modules:
        yield from (f"{module.name}.{name}" for name in ("name", "mode", "margin", "reach"))


def _packed(values: list[float]) -> bytes:
    return struct.pack(f"<{len(values)}d", *values)


def _parity(packed: bytes) -> int:
    return reduce(xor, struct.unpack(f"<{len(packed) // 8}Q", packed), 0)


def _number(value: float | UnsetType) -> float:
    return _ABSENT if value is UNSET else float(value)


_checksums: Final[dict[str, float]] = {"": 0.0, AC: float(zlib.crc32(AC.encode()))}


def _text(text: str) -> float:
    known = _checksums.get(text)
    if known is not None:
        return known
    checksum = float(zlib.crc32(text.encode()))
    # Names and modes are few and come at every tick; messages may be many.
    if len(_checksums) < 256:
        _checksums[text] = checksum
    return checksum

"""Checksums of records that decisions rest on: they tell that one was changed after it had been written.

A recording as a whole has a digest, against damage. These stand inside of the records, so that one that was changed by
whatever converted or edited the file, and gave it a digest of its own, is found as well.
"""

from __future__ import annotations

import zlib
from typing import NamedTuple

import msgspec

from soter.record.messages import PeerEvent, RobotTick


class Flaw(NamedTuple):
    """A robot's record in a tick, by its fleet time, that does not fit its checksum."""

    time_s: float
    robot_id: int


def seal(record: RobotTick | PeerEvent) -> str:
    """Return the checksum of a record: a CRC-32 over all of it but the checksum."""
    return f"{zlib.crc32(msgspec.json.encode(msgspec.structs.replace(record, check=''))):08x}"


def flaw(record: RobotTick | PeerEvent) -> Flaw | None:
    """Return what is wrong with a record, or None. A record without a checksum is wrong too."""
    return None if record.check == seal(record) else Flaw(record.time_s, record.robot_id)

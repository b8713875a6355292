"""Checksums inside the records that decisions rest on: they show if a record was changed after it was written.

A recording as a whole has a digest, against damage. A tool that converts or edits the file may give it a new digest;
the checksums show a change of a record in that case as well.
"""

from __future__ import annotations

import zlib
from typing import NamedTuple

import msgspec

from soter.record.messages import PeerEvent, RobotTick


class Flaw(NamedTuple):
    """A robot's record, at a fleet time, that does not fit its checksum."""

    time_s: float
    robot_id: int


def seal(record: RobotTick | PeerEvent) -> str:
    """Return the checksum of a record: a CRC-32 over all other fields."""
    return f"{zlib.crc32(msgspec.json.encode(msgspec.structs.replace(record, check=''))):08x}"


def flaw(record: RobotTick | PeerEvent) -> Flaw | None:
    """Return what is wrong with a record, or None. A record without a checksum is wrong too."""
    return None if record.check == seal(record) else Flaw(record.time_s, record.robot_id)

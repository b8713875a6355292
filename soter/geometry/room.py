"""What an XML file says of a room, before its parts are compared with each other. Metres, ENU."""

from __future__ import annotations

from dataclasses import dataclass

from soter.geometry.workspace import Box


@dataclass(frozen=True, slots=True)
class RoomStart:
    """Where a robot starts.

    Attributes:
        id: the robot's number, from 1.
        x_m: east.
        y_m: north.
        heading_rad: counter-clockwise from east.
        line: its line in the file.
    """

    id: int
    x_m: float
    y_m: float
    heading_rad: float
    line: int


@dataclass(frozen=True, slots=True)
class RoomBox:
    """A box of the file, on the ground or an obstacle, and its line."""

    box: Box
    line: int


@dataclass(frozen=True, slots=True)
class Room:
    """What an XML file says, each part of it allowed by itself.

    Attributes:
        width_m: how far it reaches east of the origin.
        depth_m: how far it reaches north of the origin.
        obstacles: what robots keep out of.
        stations: where robots charge, in the order of the robots.
        starts: where robots start.
    """

    width_m: float
    depth_m: float
    obstacles: tuple[RoomBox, ...]
    stations: tuple[RoomBox, ...]
    starts: tuple[RoomStart, ...]

"""Reads a site from a TOML file: polygons, circles and boxes at any angle, in metres."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from soter.geometry.draft import Draft, Outline, Spot, circle
from soter.geometry.workspace import HEIGHT_M, MAX_ROBOT_ID, Ring
from soter.geometry.workspace_xml import STATION_SIDE_M
from soter.problems import config_error, not_allowed, parse_toml, pydantic_problems

Metres = Annotated[float, Field(ge=-20_000.0, le=20_000.0)]


def _flat(corner: list[float]) -> list[float]:
    if len(corner) != 2:
        raise not_allowed("two numbers; a corner is x and y")
    return corner


Corner = Annotated[list[Metres], AfterValidator(_flat)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class CircleTable(_Table):
    """A circle, given by its middle, east and north."""

    x_m: Metres
    y_m: Metres
    radius_m: float = Field(gt=0.0, le=20_000.0)


class BoxTable(_Table):
    """A box at any angle, given by its middle; its length lies along its heading, counter-clockwise from east."""

    x_m: Metres
    y_m: Metres
    length_m: float = Field(gt=0.0, le=20_000.0)
    width_m: float = Field(gt=0.0, le=20_000.0)
    heading_deg: float = Field(default=0.0, ge=-360.0, le=360.0)


class ShapeTable(_Table):
    """A polygon, given by its corners east and north in metres; or a circle; or a box."""

    polygon: list[Corner] | None = None
    circle: CircleTable | None = None
    box: BoxTable | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        if sum(each is not None for each in (self.polygon, self.circle, self.box)) != 1:
            raise not_allowed("one of polygon, circle and box")
        return self

    def ring(self, *, around: bool) -> Ring:
        """Return the corners; `around` says whether a circle's polygon contains the circle, or is contained in it."""
        if self.polygon is not None:
            return tuple((x, y) for x, y in self.polygon)
        if self.circle is not None:
            return circle(self.circle.x_m, self.circle.y_m, self.circle.radius_m, around=around)
        assert self.box is not None
        box, angle = self.box, math.radians(self.box.heading_deg)
        ahead = box.length_m / 2.0 * math.cos(angle), box.length_m / 2.0 * math.sin(angle)
        aside = -box.width_m / 2.0 * math.sin(angle), box.width_m / 2.0 * math.cos(angle)
        return tuple(
            (box.x_m + a * ahead[0] + b * aside[0], box.y_m + a * ahead[1] + b * aside[1])
            for a, b in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
        )


class KeepOutTable(ShapeTable):
    """An area that robots keep out of."""

    name: str = ""
    height_m: float = Field(default=HEIGHT_M, gt=0.0, le=1000.0)


class StationTable(_Table):
    """A charging station, a square given by its middle, east and north."""

    x_m: Metres
    y_m: Metres
    side_m: float = Field(default=STATION_SIDE_M, ge=0.001, le=100.0)

    def spot(self, number: int) -> Spot:
        """Return the draft's spot for this station, which has this number, from 1."""
        return Spot(f"station {number}", self.x_m, self.y_m, side_m=self.side_m)


class RobotTable(_Table):
    """Where a robot starts.

    Attributes:
        id: its number, from 1.
        x_m: east.
        y_m: north.
        heading_rad: counter-clockwise from east.
    """

    id: int = Field(ge=1, le=MAX_ROBOT_ID)
    x_m: Metres
    y_m: Metres
    heading_rad: float = Field(default=0.0, ge=-1000.0, le=1000.0)

    def spot(self) -> Spot:
        """Return the draft's spot for this start."""
        return Spot(f"robot {self.id}", self.x_m, self.y_m, self.id, self.heading_rad)


class SiteTable(_Table):
    """A site.

    Attributes:
        fence: the outer boundary, if the site has one.
        keep_out: areas that robots keep out of.
        station: where robots charge, in the order of the robots.
        robot: where robots start; on their stations if not given.
    """

    fence: ShapeTable | None = None
    keep_out: list[KeepOutTable] = []
    station: list[StationTable] = []
    robot: list[RobotTable] = []


def read(data: bytes, source: str) -> Draft:
    """Return the draft in a TOML file.

    Raises:
        ConfigError: the file is no TOML, or a key or a value in it is not allowed.
    """
    tables, lines = parse_toml(data, source, "workspace file")
    try:
        table = SiteTable.model_validate(tables)
    except ValidationError as failure:
        raise config_error(pydantic_problems(failure, SiteTable, lines=lines), source) from failure
    draft = Draft(source)
    if table.fence is not None:
        draft.fences.append(Outline("fence", table.fence.ring(around=False)))
    for number, each in enumerate(table.keep_out, start=1):
        name = each.name or f"keep_out {number}"
        draft.keep_outs.append(Outline(name, each.ring(around=True), each.height_m))
    draft.stations += [each.spot(number) for number, each in enumerate(table.station, start=1)]
    draft.starts += [each.spot() for each in table.robot]
    return draft

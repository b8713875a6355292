"""A world as a file or a program hands it over: JSON in metres, east and north, radians counter-clockwise from east.

```json
{"width_m": 5, "depth_m": 5, "boxes": [[2, 0, 3, 1]], "chargers": [[0.8, 0.8, 1.2, 1.2]],
 "robots": [{"id": 1, "x_m": 1, "y_m": 1, "heading_rad": 0, "battery": 1.0,
             "drive_s": 1800, "idle_s": 7200, "charge_s": 60}],
 "limits": {"separation_m": 0.3, "clearance_m": 0}}
```

Rectangles are west, south, east and north edge. The limits are those that the truth judges by, see
`soter.sdk.RuleLimits`. They may be left out, and so may all but `id`, `x_m` and `y_m` of a robot. What a robot is to
promise, `promised`, has all of `soter.sdk.Capabilities`.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.problems import Problem, config_error, pydantic_problems
from soter.sdk.values import Capabilities, RobotSpec, RuleLimits

Metres = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Seconds = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Rectangle = tuple[Metres, Metres, Metres, Metres]


class _Described(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RobotModel(_Described):
    """One robot; see `soter.sdk.RobotSpec`."""

    id: Annotated[int, Field(ge=1, le=254)]
    x_m: Metres
    y_m: Metres
    heading_rad: Metres = 0.0
    battery: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    drive_s: Seconds = 1800.0
    idle_s: Seconds = 7200.0
    charge_s: Seconds = 60.0
    promised: Capabilities | None = None


class LimitsModel(_Described):
    """What a mission promises; see `soter.sdk.RuleLimits`."""

    separation_m: NotNegative = RuleLimits().separation_m
    clearance_m: NotNegative = RuleLimits().clearance_m


class WorldModel(_Described):
    """A world and the robots in it."""

    width_m: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
    depth_m: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
    boxes: tuple[Rectangle, ...] = ()
    chargers: tuple[Rectangle, ...] = ()
    robots: Annotated[tuple[RobotModel, ...], Field(min_length=1)]
    limits: LimitsModel = LimitsModel()


def read_world(data: bytes, source: str) -> tuple[Workspace, list[RobotSpec], RuleLimits]:
    """Read a world, its robots and its limits; `source` names it in errors.

    Raises:
        ConfigError: it is no JSON, or says something that is not allowed; every mistake is named.
    """
    try:
        world = WorldModel.model_validate_json(data)
    except ValidationError as failure:
        raise config_error(pydantic_problems(failure, WorldModel), source) from failure
    problems = [
        Problem("allowed: west below east and south below north", f"{name}.{index}")
        for name, rectangles in (("boxes", world.boxes), ("chargers", world.chargers))
        for index, (west, south, east, north) in enumerate(rectangles)
        if not (west < east and south < north)
    ]
    if problems:
        raise config_error(problems, source)
    places = []
    for number, patch in enumerate(world.chargers, 1):
        charger = Box(*patch)
        places.append(RobotPlace(number, *charger.centre, charger))
    workspace = Workspace(world.width_m, world.depth_m, tuple(Box(*box) for box in world.boxes), tuple(places))
    robots = [RobotSpec(**dict(robot)) for robot in world.robots]
    return workspace, robots, RuleLimits(**world.limits.model_dump())

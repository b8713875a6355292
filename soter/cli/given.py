"""A robot of a mission file that the kit does not start, for `soter measure` and `soter conform`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from soter.cli.option import option
from soter.cli.overrides import load_with_engine, merge
from soter.errors import ConfigError

if TYPE_CHECKING:
    from soter.conformance.given import Given

Room = Annotated[
    float | None,
    option(
        "METRES",
        "The diameter of the free circle around the robot's start, in which it is driven.",
        "--room",
        show_default=False,
    ),
]
RobotNumber = Annotated[
    int | None,
    option("N", "Which robot of the mission; the first if not given.", "--robot", min=1),
]


def read_given(
    mission: Path, backend: str | None, settings: list[str] | None, robot: int | None, room_m: float | None
) -> Given:
    """Return a robot of a mission file, and the room in which it may be driven.

    Raises:
        ConfigError: bad input: there is no such robot, no room was given, or the room is not free.
    """
    from soter.conformance.given import Given
    from soter.registry import load_backend
    from soter.specs import asked, read_options, robot_specs

    loaded = load_with_engine(mission, merge({"backend": backend}, settings))
    workspace = loaded.read_workspace()
    kind = load_backend(loaded.backend)
    config = read_options(kind, loaded, workspace)
    specs = {spec.id: spec for spec in robot_specs(loaded, workspace, asked(kind, config, loaded, workspace))}
    number = next(iter(specs)) if robot is None else robot
    if number not in specs:
        raise ConfigError(f"the mission has no robot {number}; allowed: {', '.join(map(str, specs))}", key="--robot")
    if room_m is None:
        raise ConfigError(
            "say how large the free circle around the robot's start is: its diameter in metres", key="--room"
        )
    given = Given(loaded.backend, config, specs[number], room_m)
    given.check(workspace)
    return given

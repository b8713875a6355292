"""`soter measure`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from soter.cli.exits import ExitCode, Force, StopSignals, guard
from soter.cli.given import RobotNumber, Room, read_given
from soter.cli.option import option
from soter.cli.overrides import MissionArgument, OtherBackend, Settings

if TYPE_CHECKING:
    from rich.console import Console

    from soter.conformance.given import Given
    from soter.conformance.survey import Survey

EXAMPLES = """Examples:
  soter measure examples/ardurover/mission.toml --room 11
  soter measure examples/ardurover/mission.toml --room 11 --set backends.mavlink.truth=127.0.0.1:34207 -o promise.toml
  soter measure examples/surveillance.toml --backend kinematic --room 2 --margin 0.1
Exit codes:
  0  everything that can be measured was
  1  something could not be, and the reason is said; the table has the rest
  2  bad input, or a backend that cannot be used here
  3  the file could not be written
  130  interrupted (in general 128 and the number of the signal); the robot has been stopped
"""


def measure(
    mission: MissionArgument,
    room: Room = None,
    robot: RobotNumber = None,
    backend: OtherBackend = None,
    settings: Settings = None,
    margin: Annotated[float, option("SHARE", "What is spared of each figure.", min=0.0, max=0.9)] = 0.2,
    output: Annotated[Path | None, option("FILE", "Write the promise table, as TOML.", "--output", "-o")] = None,
    json: Annotated[Path | None, option("FILE", "Write all figures; - is standard output.")] = None,
    force: Force = False,
) -> None:
    """Drive one robot about a free circle, and say what it may promise: latency, speed, brake, tube, noise and more.

    What the mission file promises is where measuring begins. Where a truth is told it judges, and elsewhere the robot's
    own estimate, which cannot know how far it is off.
    """
    with guard(), StopSignals() as stop:
        from soter.cli.conform_output import Outcomes
        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs, as_json, unwritten
        from soter.config.toml_text import toml
        from soter.conformance.survey import STEPS, survey

        given = read_given(mission, backend, settings, robot, room)
        files = Outputs({"--output": output, "--json": json}, (mission,), force=force)
        console = make_console(stderr=files.to_stdout)
        spec = given.spec
        console.print(
            f"robot {spec.id} drives within {given.radius_m:.1f} m of its start, ({spec.x_m:g}, {spec.y_m:g})",
            soft_wrap=True,
        )
        with Outcomes(console, STEPS) as shown:
            found = survey(given, margin, stop, lambda outcome, _: shown.add(outcome))
        _show(console, found)
        text = toml({"backends": {given.backend: {"promise": dict(found.table)}}})
        with unwritten("what was measured"):
            files.write("--output", _file(found, given, mission, margin, text).encode)
            files.write("--json", lambda: as_json(_content(found, mission)))
        console.print(f"\n{text.strip()}" if output is None else f"\nwritten: {output}", soft_wrap=True)
        if stop.received is not None:
            raise typer.Exit(128 + stop.received)
        raise typer.Exit(ExitCode.OK if found.complete else ExitCode.VIOLATION)


def _show(console: Console, found: Survey) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim")
    right = ("declared", "measured", "had better be")
    for name in ("promise", *right, "judged by"):
        table.add_column(name, justify="right" if name in right else "left", no_wrap=True)
    for each in found.advice:
        if each.measured is None:
            table.add_row(each.name, f"{each.promised:.3g}", "-", "-", "not measured")
        else:
            row = (each.name, f"{each.promised:.3g}", f"{each.measured:.3g}", f"{each.declared:.3g}")
            table.add_row(*row, each.judge)
    console.print()
    console.print(table)


def _file(found: Survey, given: Given, mission: Path, margin: float, text: str) -> str:
    judges = " and ".join(sorted({each.judge for each in found.advice if each.judge}))
    missing = ", ".join(each.name for each in found.advice if each.measured is None)
    return (
        f"# `soter measure` of robot {given.spec.id} of {mission.name} found this in a circle of {given.room_m:g} m,\n"
        f"# with a margin of {margin:.0%}; judged by {judges or 'nothing'}.\n"
        f"# Not measured: {missing or 'nothing'}.\n\n{text}"
    )


def _content(found: Survey, mission: Path) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "format": "soter-measure",
        "target": str(mission),
        "complete": found.complete,
        "promises": [asdict(each) for each in found.advice],
        "table": dict(found.table),
        "record": found.record.as_dict(),
    }

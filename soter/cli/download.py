"""`soter download`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from soter.cli.exits import ExitCode, Force, StopSignals, guard
from soter.cli.option import option
from soter.cli.overrides import MissionArgument, OtherBackend, Settings

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from soter.geometry.workspace import Workspace
    from soter.sdk import HeldMission

EXAMPLES = """Examples:
  soter download examples/ardurover/mission.toml
  soter download examples/ardurover/mission.toml -o flown.toml
Exit codes:
  0  what the vehicles hold was read
  1  no vehicle holds a place to go to; nothing is written
  2  bad input, a backend that cannot be used here, or a vehicle that does not answer
  3  the file could not be written
  130  interrupted (in general 128 and the number of the signal)
"""


def download(
    mission: MissionArgument,
    backend: OtherBackend = None,
    settings: Settings = None,
    timeout: Annotated[float, option("SECONDS", "How long to wait for the vehicles.", min=0.1, max=600.0)] = 10.0,
    output: Annotated[
        Path | None, option("FILE", "Write the mission with these places to visit, as a new file.", "--output", "-o")
    ] = None,
    json: Annotated[Path | None, option("FILE", "Write what was read; - is standard output.")] = None,
    force: Force = False,
) -> None:
    """Read the missions that vehicles hold, such as a .plan that a ground station has sent them. Nothing moves.

    Places to visit are kept, in metres in the mission's workspace; what else a plan says is shown, and left out.
    """
    with guard(), StopSignals() as stop:
        from soter.cli.console import make_console
        from soter.cli.mission_text import mission_text
        from soter.cli.outputs import Outputs, as_json, unwritten
        from soter.cli.overrides import load_with_engine, merge
        from soter.registry import load_backend
        from soter.specs import read_options

        loaded = load_with_engine(mission, merge({"backend": backend}, settings))
        workspace = loaded.read_workspace()
        files = Outputs({"--output": output, "--json": json}, (mission, loaded.workspace), force=force)
        console = make_console(stderr=files.to_stdout)
        kind = load_backend(loaded.backend)
        ids = [place.id for place in workspace.robots]
        options = read_options(kind, loaded, workspace)
        with stop.raising():
            held = kind().read_missions(options, ids, timeout)
        _show(console, held, workspace)
        found = {str(robot_id): [*map(list, each.points)] for robot_id, each in held.items() if each.points}
        with unwritten("what was read"):
            files.write("--json", lambda: as_json(_content(held, mission)))
            if output is not None and found:
                head = f"{mission.name} with the missions that its vehicles hold, by `soter download`."
                flown = {"backend": backend, "mission": {"use": "waypoints", "robots": found}}
                loaded = load_with_engine(mission, merge(flown, settings))
                files.write("--output", mission_text(loaded, {}, output, head).encode)
                console.print(f"\nwritten: {output}", soft_wrap=True)
        if not found:
            raise typer.Exit(ExitCode.VIOLATION)


def _show(console: Console, held: Mapping[int, HeldMission], workspace: Workspace) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for head in ("robot", "place", "x (m)", "y (m)"):
        table.add_column(head, justify="right")
    table.add_column("")
    for robot_id, each in held.items():
        for number, (x_m, y_m) in enumerate(each.points, 1):
            is_free = workspace.contains(x_m, y_m) and workspace.clearance_m(x_m, y_m, 0.0) >= 0.0
            what = "" if is_free else "[red]not in the free area: it will be refused[/red]"
            table.add_row(str(robot_id), str(number), f"{x_m:.2f}", f"{y_m:.2f}", what)
    console.print(table)
    for robot_id, each in held.items():
        if not each.points:
            console.print(f"robot {robot_id} holds no place to go to")
        if each.left_out:
            console.print(f"robot {robot_id}, left out: {', '.join(each.left_out)}", soft_wrap=True)


def _content(held: Mapping[int, HeldMission], mission: Path) -> dict[str, Any]:
    robots = {str(robot_id): {"points": each.points, "left_out": each.left_out} for robot_id, each in held.items()}
    return {"format": "soter-download", "target": str(mission), "robots": robots}

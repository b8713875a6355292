"""`soter tune`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from soter.cli.exits import ExitCode, Force, guard
from soter.cli.option import option
from soter.cli.overrides import MissionArgument, Promising, Settings, load_with_engine, merge

if TYPE_CHECKING:
    from rich.console import Console

    from soter.check.tune import Choice, Tuning

EXAMPLES = """Examples:
  soter tune examples/surveillance.toml --backend kinematic
  soter tune examples/thesis.toml -o tuned.toml
Exit codes:
  0  numbers were found, and soter run takes the mission with them
  1  none were: the findings say why soter run would refuse the mission; nothing is written
  2  bad input, or a backend that cannot be used here
  3  the file could not be written
"""


def tune(
    mission: MissionArgument,
    backend: Promising = None,
    settings: Settings = None,
    output: Annotated[
        Path | None, option("FILE", "Write the whole mission with what was found, as a new file.", "--output", "-o")
    ] = None,
    force: Force = False,
    json: Annotated[Path | None, option("FILE", "Write what was found; - is standard output.")] = None,
) -> None:
    """Find the least restrictive numbers of the safety modules that are well-formed on the mission's robots.

    Delta, model and phi_safer of collision, obstacle and geofence, as TOML tables. The dwell and the battery's numbers,
    which no proof asks to be larger, are kept.
    """
    with guard():
        from soter.check.tune import tune as find
        from soter.cli.console import make_console
        from soter.cli.mission_text import mission_text
        from soter.cli.outputs import Outputs, as_json, unwritten
        from soter.config.toml_text import toml

        loaded = load_with_engine(mission, merge({"backend": backend}, settings))
        files = Outputs({"--output": output, "--json": json}, (mission, loaded.workspace), force=force)
        console = make_console(stderr=files.to_stdout)
        tuning = find(loaded)
        _show(console, tuning)
        with unwritten("what was found"):
            files.write("--json", lambda: as_json(_content(tuning, mission)))
            if output is not None and not tuning.refused:
                head = f"{mission.name} as `soter tune` would have it, for the robots of {tuning.mission.backend}."
                text = mission_text(tuning.mission, tuning.changes(), output, head)
                files.write("--output", text.encode)
        if tuning.refused:
            raise typer.Exit(ExitCode.VIOLATION)
        console.print(
            f"\n{toml(tuning.tables()).strip()}" if output is None else f"\nwritten: {output}", soft_wrap=True
        )


def _show(console: Console, tuning: Tuning) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for head in ("module", "", "Delta", "model"):
        table.add_column(head)
    for head in ("R(H)", "usual", "asked", "phi_safer"):
        table.add_column(head, justify="right")
    for name, found in tuning.found.items():
        others = [each for each in tuning.trade.get(name, ()) if each != found]
        rows = [(tuning.today[name], "today"), (found, "found"), *((each, "") for each in others)]
        for index, (choice, what) in enumerate(rows):
            style = "bold" if what == "found" else "red" if choice.why_not else ""
            table.add_row("" if index else name, what, *_cells(choice), style=style, end_section=index == len(rows) - 1)
    console.print(table)
    for name, choice in tuning.today.items():
        if choice.why_not:
            console.print(f"today {name} is ill-formed, {choice.why_not}", soft_wrap=True)
    for each in tuning.refused:
        console.print(f"refused: {each.module}  {each.condition}  {each.verdict.value}  {each.text}", soft_wrap=True)


def _cells(choice: Choice) -> list[str]:
    figures = [f"{value:.3f}" for value in (choice.reach, choice.usual, choice.needed, choice.phi_safer)]
    return [f"{choice.delta_s:g} s", choice.model, *figures]


def _content(tuning: Tuning, mission: Path) -> dict[str, Any]:
    import math
    from dataclasses import asdict

    def told(choice: Choice) -> dict[str, Any]:
        figures = asdict(choice).items()
        return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in figures}

    return {
        "format": "soter-tune",
        "target": str(mission),
        "backend": tuning.mission.backend,
        "refused": [each.as_dict() for each in tuning.refused],
        "tables": None if tuning.refused else tuning.tables(),
        "today": {name: told(each) for name, each in tuning.today.items()},
        "found": {name: told(each) for name, each in tuning.found.items()},
        "trade": {name: [told(each) for each in choices] for name, choices in tuning.trade.items()},
    }

"""`soter conform`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli.complete import robots
from soter.cli.exits import ExitCode, Force, StopSignals, guard
from soter.cli.given import RobotNumber, Room, read_given
from soter.cli.option import option, switch
from soter.cli.overrides import Settings
from soter.errors import ConfigError, nearest

if TYPE_CHECKING:
    from soter.conformance.given import Given

EXAMPLES = """Examples:
  soter conform pybullet
  soter conform my_robots.harness:MyHarness --json record.json --junit junit.xml --jobs 1
  soter conform kinematic --only deadman --only goto.arrives
  soter conform mavlink --tier wire
  soter conform examples/ardurover/mission.toml --robot 1 --room 11
Exit codes:
  0  the adapter conforms, or passes the clauses that were selected
  1  it does not conform
  2  bad input, or a backend that cannot be used here
  3  a file could not be written
  130  interrupted (in general 128 and the number of the signal); files hold what there was by then
"""


def conform(
    adapter: Annotated[
        str | None,
        typer.Argument(
            metavar="BACKEND|MODULE:HARNESS|MISSION",
            help="A backend's name, a harness of your own, or a mission file with a robot that is there already.",
            show_default=False,
            autocompletion=robots,
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        option("ID", "Only this clause, or this group of clauses, with how the truth judges them; may be repeated."),
    ] = None,
    tier: Annotated[
        list[str] | None, option("TIER", "Only clauses of this tier: core, truth or wire; may be repeated.")
    ] = None,
    room: Room = None,
    robot: RobotNumber = None,
    settings: Settings = None,
    jobs: Annotated[
        int | None,
        option(
            "N",
            "How many clauses to try side by side, each in a process, if the harness allows; "
            "four a core, at most 8, on a wire if not given, and otherwise 1.",
            min=1,
        ),
    ] = None,
    json: Annotated[
        Path | None, option("FILE", "Write the record, anew with every clause; - is standard output.")
    ] = None,
    junit: Annotated[Path | None, option("FILE", "Write JUnit XML; - is standard output.")] = None,
    force: Force = False,
    list_clauses: Annotated[bool, switch("--list", "List the clauses and exit.")] = False,
) -> None:
    """Try an adapter against every clause of the conformance kit and say whether it conforms."""
    with guard(), StopSignals() as stop:
        import time

        from soter.cli.conform_output import Files, Outcomes, print_list, print_summary
        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs
        from soter.conformance import Outcome, Overall, Record, Tier, Workshop, select
        from soter.loading import find_from_here

        find_from_here()
        tiers = {each.value: each for each in Tier}
        for name in tier or ():
            if name not in tiers:
                raise ConfigError(
                    f"there is no tier '{name}'{nearest(name, list(tiers))}; allowed: {', '.join(tiers)}", key="--tier"
                )
        given_only = {"--room": room, "--robot": robot, "--set": settings}
        clauses = select(only or (), [tiers[name] for name in tier or ()])
        console = make_console(stderr="-" in (str(json), str(junit)))
        if list_clauses:
            print_list(console, clauses)
            return
        if adapter is None:
            raise ConfigError("say which: a backend's name, or module:Harness; `soter backends` lists the backends")
        if str(json) == "-" == str(junit):
            raise ConfigError("--json and --junit cannot both go to standard output", source="command line")
        files = Files(Outputs({"--json": json, "--junit": junit}, force=force).files)
        began_s = time.monotonic()
        target: str | Given = adapter
        if adapter.endswith(".toml"):
            target = read_given(Path(adapter), None, settings, robot, room)
        elif wrong := next((key for key, value in given_only.items() if value), None):
            raise ConfigError(f"it is for a robot that is there; '{adapter}' is no mission file", key=wrong)
        with Workshop(target, jobs, stop) as workshop, Outcomes(console, len(clauses)) as shown:
            if jobs is not None and workshop.jobs < jobs:
                console.print(f"{workshop.name}: one clause after another; its harness does not say `side_by_side`")

            def add(outcome: Outcome, record: Record) -> None:
                shown.add(outcome)
                files.keep_up(record)

            record = workshop.judge(clauses, add, shown.begin)
        print_summary(console, record, time.monotonic() - began_s, shown.load)
        written = files.finish(record)
        if stop.received is not None:
            raise typer.Exit(128 + stop.received)
        if not written:
            raise typer.Exit(ExitCode.RUN_FAILED)
        raise typer.Exit(ExitCode.VIOLATION if record.overall is Overall.FAILS else ExitCode.OK)

"""`soter ablate`."""

from __future__ import annotations

import shlex
import sys
from contextlib import ExitStack
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli.exits import ExitCode, Force, StopSignals, complain, guard
from soter.cli.overrides import MissionArgument, Settings
from soter.cli.plain import emit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from soter.ablation.ablate import Outcome, Plan, Variant
    from soter.ablation.tables import Row

EXAMPLES = """Examples:

  soter ablate examples/surveillance.toml --only 'without*' --duration 600

  soter ablate examples/surveillance.toml --force-ill-formed --markdown ablation.md

Exit codes:

  0  everything was run

  1  a rule was broken although nothing was taken away from the modules

  2  bad input: nothing was run

  3  a run failed

  130  interrupted by Ctrl-C; what was finished is written
"""


def ablate(
    mission: MissionArgument,
    seeds: Annotated[str, typer.Option(metavar="A,B", help="Each variant runs once with each.")] = "1,2",
    duration: Annotated[float, typer.Option(metavar="SECONDS", help="Of each run, in the robots' time.")] = 1800.0,
    backend: Annotated[str, typer.Option(metavar="NAME", help="Simulated robots of this process.")] = "kinematic",
    targets: Annotated[str, typer.Option(metavar="grid|uniform|hostile", help="Where robots are sent.")] = "hostile",
    only: Annotated[
        str | None, typer.Option(metavar="PATTERN", help="Only variants of which group or group/name match.")
    ] = None,
    jobs: Annotated[int, typer.Option(metavar="N", min=1, help="Runs at a time.")] = 1,
    force_ill_formed: Annotated[
        bool, typer.Option("--force-ill-formed", help="Run ill-formed variants too; simulated robots only.")
    ] = False,
    json: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write every outcome; - is standard output.")
    ] = None,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the tables as a page.")] = None,
    settings: Settings = None,
    force: Force = False,
    listed: Annotated[bool, typer.Option("--list", help="Name the variants and run nothing.")] = False,
) -> None:
    """Run a mission with one part of its safety modules changed at a time, and compare.

    Modules are left out, look too rarely or not far enough ahead, give back too early; adversaries take the AC's place.
    """
    with guard():
        from soter.ablation.ablate import Plan, variants
        from soter.cli.console import make_console
        from soter.cli.outputs import Output, json_output, refuse_clashes
        from soter.cli.overrides import load_with_engine, merge
        from soter.registry import load_backend

        given = {"backend": backend, "duration_s": duration, "targets": targets}
        overrides = merge(given, settings or [])
        loaded = load_with_engine(mission, overrides, None)
        chosen = [each for each in variants(loaded.rta.module) if only is None or _matches(each, only)]
        if not chosen:
            raise _refusal("--only", f"no variant matches '{only}'; --list names them all")
        if listed:
            for variant in chosen:
                emit(f"{variant.group}/{variant.name}")
            return
        loaded.read_workspace()
        if not load_backend(loaded.backend, to_open=False).robot_class.declared.in_process:
            raise loaded.refusal(
                "backend",
                f"it is '{loaded.backend}', allowed: a backend in virtual time, such as kinematic: parts of "
                "the modules are taken from simulated robots only",
            )
        refuse_clashes({"--json": json, "--markdown": markdown}, (mission, loaded.workspace), force=force)
        json_file = None if json is None else json_output(json)
        page = None if markdown is None else Output(markdown, "--markdown")
        plan = Plan(mission, overrides, _numbers(seeds), force_ill_formed)
        console = make_console(stderr=str(json) == "-")
        outcomes, stopped_by = _run(plan, chosen, jobs, console)

        from soter.ablation.tables import rows

        found = rows(outcomes, chosen)
        _show(found, console)
        written = True
        try:
            if json_file is not None:
                json_file.write(_json(outcomes))
            if page is not None:
                from soter.ablation.tables import markdown as as_markdown

                page.write(as_markdown(found, shlex.join(["soter", *sys.argv[1:]])).encode())
        except OSError as failure:
            complain(f"the tables could not be written: {failure}")
            written = False
        raise typer.Exit(_exit_code(outcomes, stopped_by) if written else ExitCode.RUN_FAILED)


def _matches(variant: Variant, pattern: str) -> bool:
    return fnmatch(variant.group, pattern) or fnmatch(f"{variant.group}/{variant.name}", pattern)


def _refusal(option: str, message: str) -> Exception:
    from soter.errors import ConfigError

    return ConfigError(message, source="command line", key=option)


def _numbers(text: str) -> list[int]:
    """Return the seeds."""
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdecimal() for part in parts):
        raise _refusal("--seeds", f"it is '{text}', allowed: whole numbers from 0, separated by commas, such as 1,2")
    numbers = [int(part) for part in parts]
    if len(set(numbers)) != len(numbers):
        raise _refusal("--seeds", f"it is '{text}', allowed: each seed once")
    return numbers


def _run(plan: Plan, chosen: Sequence[Variant], jobs: int, console: Console) -> tuple[list[Outcome], int | None]:
    """Run everything and show how far it is; return also the signal that ended it, if one did."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from soter.ablation.ablate import run_all

    outcomes: list[Outcome] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with ExitStack() as stack:
        stop = stack.enter_context(StopSignals())
        progress = stack.enter_context(Progress(*columns, console=console))
        task = progress.add_task("runs", total=len(chosen) * len(plan.seeds))
        for outcome in run_all(plan, chosen, jobs, stop):
            outcomes.append(outcome)
            progress.advance(task)
    return outcomes, stop.received


def _show(found: Sequence[Row], console: Console) -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from soter.ablation.tables import HEAD, ac_only

    compared = ac_only(found)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("group", *HEAD):
        table.add_column(column)
    for row in found:
        table.add_row(*map(Text, (row.variant.group, *row.cells(compared))))
    console.print(table)


def _json(outcomes: Sequence[Outcome]) -> bytes:
    import json

    return f"{json.dumps([_as_dict(outcome) for outcome in outcomes], indent=2)}\n".encode()


def _as_dict(outcome: Outcome) -> dict[str, object]:
    variant, result = outcome.variant, outcome.result
    return {
        "group": variant.group,
        "variant": variant.name,
        "overrides": dict(variant.overrides),
        "deltas": variant.deltas,
        "safer_alone": variant.safer_alone,
        "seed": outcome.seed,
        "ill_formed": outcome.ill_formed,
        "forced": bool(outcome.ill_formed) and result is not None,
        "failure": outcome.failure,
        "result": None if result is None else result.model_dump(mode="json"),
    }


def _exit_code(outcomes: Sequence[Outcome], stopped_by: int | None) -> int:
    if stopped_by is not None:
        return 128 + stopped_by
    if any(outcome.breaks_promise for outcome in outcomes):
        return ExitCode.VIOLATION
    return ExitCode.RUN_FAILED if any(outcome.failure for outcome in outcomes) else ExitCode.OK

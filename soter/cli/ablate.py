"""`soter ablate`."""

from __future__ import annotations

import shlex
import sys
import textwrap
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from soter.cli import complete
from soter.cli.exits import ExitCode, Force, StopSignals, guard
from soter.cli.option import option, switch
from soter.cli.overrides import MissionArgument, Settings, load_with_engine, merge
from soter.cli.plain import emit
from soter.errors import option_error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from soter.ablation.ablate import Plan, Variant, VariantRun
    from soter.ablation.tables import VariantRow

_LABEL: Final = 19
"""Width of a variant's name on a terminal of 80 columns; the rest of the name goes beside the next rule."""

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
    seeds: Annotated[str, option("A,B", "Each variant runs once with each.")] = "1,2",
    duration: Annotated[float, option("SECONDS", "Of each run, in the robots' time.")] = 1800.0,
    backend: Annotated[
        str, option("NAME", "Simulated robots of this process.", autocompletion=complete.engines)
    ] = "kinematic",
    targets: Annotated[
        str, option("grid|uniform|hostile", "Where robots are sent.", autocompletion=complete.targets)
    ] = "hostile",
    only: Annotated[str | None, option("PATTERN", "Only variants of which group or group/name match.")] = None,
    jobs: Annotated[int, option("N", "Runs at a time.", min=1)] = 1,
    force_ill_formed: Annotated[
        bool, switch("--force-ill-formed", "Run ill-formed variants too; simulated robots only.")
    ] = False,
    json: Annotated[Path | None, option("FILE", "Write every outcome; - is standard output.")] = None,
    markdown: Annotated[Path | None, option("FILE", "Write the tables as a page.")] = None,
    settings: Settings = None,
    force: Force = False,
    listed: Annotated[bool, switch("--list", "Name the variants and run nothing.")] = False,
) -> None:
    """Run a mission with one part of its safety modules changed at a time, and compare.

    Modules are left out, look too rarely or not far enough ahead, give back too early; adversaries take the AC's place.
    """
    with guard():
        from soter.ablation.ablate import Plan, variants
        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs, as_json, unwritten
        from soter.registry import in_virtual_time

        given = {"backend": backend, "duration_s": duration, "targets": targets}
        overrides = merge(given, settings)
        loaded = load_with_engine(mission, overrides)
        chosen = [each for each in variants(loaded.rta.module) if only is None or _matches(each, only)]
        if not chosen:
            raise option_error("--only", f"no variant matches '{only}'; --list names them all")
        if listed:
            for variant in chosen:
                emit(f"{variant.group}/{variant.name}")
            return
        loaded.read_workspace()
        if not in_virtual_time(loaded.backend):
            raise loaded.refusal(
                "backend",
                f"it is '{loaded.backend}', allowed: a backend in virtual time, such as kinematic: parts of "
                "the modules are taken from simulated robots only",
            )
        files = Outputs({"--json": json, "--markdown": markdown}, (mission, loaded.workspace), force=force)
        plan = Plan(mission, overrides, _numbers(seeds), force_ill_formed)
        console = make_console(stderr=files.to_stdout)
        outcomes, stopped_by = _run(plan, chosen, jobs, console)

        from soter.ablation.tables import markdown as as_markdown
        from soter.ablation.tables import rows

        found = rows(outcomes, chosen)
        _show(found, console)
        with unwritten("the tables"):
            files.write("--json", lambda: as_json([_as_dict(each) for each in outcomes], allow_nan=True))
            files.write("--markdown", as_markdown(found, shlex.join(["soter", *sys.argv[1:]])).encode)
        raise typer.Exit(_exit_code(outcomes, stopped_by))


def _matches(variant: Variant, pattern: str) -> bool:
    return fnmatch(variant.group, pattern) or fnmatch(f"{variant.group}/{variant.name}", pattern)


def _numbers(text: str) -> list[int]:
    """Return the seeds in the value of `--seeds`."""
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdecimal() for part in parts):
        raise option_error(
            "--seeds", f"it is '{text}', allowed: whole numbers from 0, separated by commas, such as 1,2"
        )
    numbers = [int(part) for part in parts]
    if len(set(numbers)) != len(numbers):
        raise option_error("--seeds", f"it is '{text}', allowed: each seed once")
    return numbers


def _run(plan: Plan, chosen: Sequence[Variant], jobs: int, console: Console) -> tuple[list[VariantRun], int | None]:
    """Run all variants and show the progress; return also the signal that ended the runs, if there was one."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    from soter.ablation.ablate import run_all

    outcomes: list[VariantRun] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TextColumn("left"), TimeRemainingColumn())  # fmt: skip
    with StopSignals() as stop, Progress(*columns, console=console) as progress:
        task = progress.add_task("runs", total=len(chosen) * len(plan.seeds))
        for outcome in run_all(plan, chosen, jobs, stop):
            outcomes.append(outcome)
            progress.advance(task)
    return outcomes, stop.received


def _show(found: Sequence[VariantRow], console: Console) -> None:
    """Print a line for each variant and rule with a finding; --markdown writes the whole tables."""
    from rich.text import Text

    from soter.ablation.tables import ac_only
    from soter.cli.console import print_table
    from soter.sdk import RULES

    compared = ac_only(found)
    lines: list[tuple[str | Text, ...]] = []
    remarks: list[str] = []
    group = ""
    for row in found:
        name = row.variant.name
        if row.variant.group != group:
            group = row.variant.group
            lines.append((Text(group, "bold"), *[""] * 6))
        _, violations, share, rate, margins, _, of_ac, remark = row.cells(compared)
        if remark:
            # What would do for a module is the same for many variants: their lines in the table have the mark.
            alike = row.mark and remark.startswith(row.mark)
            remarks.append(remark if alike else f"{group}/{name}: {remark}")
        counts, least = violations.split(" / "), margins.split(" / ")
        own = counts[len(RULES) :]
        label = textwrap.wrap(name, _LABEL, initial_indent=" ", subsequent_indent=" ")
        if not row.results:
            done, _, condition = row.mark.partition(" ")
            lines.append(("\n".join(label), done or "failed", condition, "", "", "", ""))
        elif row.mark:
            label.append(f" {row.mark}")
        for index, rule in enumerate(RULES if row.results else ()):
            figures = (share, rate, of_ac) if index == 0 else ("", "", "")
            style = "" if counts[index] == "0" else "bold red"
            said = label[index] if index < len(label) else ""
            lines.append((said, rule, Text(counts[index], style), least[index], *figures))
        lines += [("", each.rpartition(" ")[0], each.rpartition(" ")[2], "", "", "", "") for each in own]
    head = ("variant", "rule", "vio-\nlated", "least\nmargin", "AC\nshare", "diseng.\nper h", "reached,\nof AC")
    print_table(console, head, lines)
    for remark in dict.fromkeys(remarks):
        console.print(remark, soft_wrap=True)
    if any(row.mark for row in found):
        console.print("--json FILE has the reasons in full.")


def _as_dict(outcome: VariantRun) -> dict[str, object]:
    variant, result = outcome.variant, outcome.result
    return {
        "group": variant.group,
        "variant": variant.name,
        "overrides": dict(variant.overrides),
        "deltas": variant.deltas,
        "safer_alone": variant.safer_alone,
        "seed": outcome.seed,
        "ill_formed": outcome.refusal.text if outcome.refusal else "",
        "forced": outcome.refusal is not None and result is not None,
        "failure": outcome.failure,
        "result": None if result is None else result.model_dump(mode="json"),
    }


def _exit_code(outcomes: Sequence[VariantRun], stopped_by: int | None) -> int:
    if stopped_by is not None:
        return 128 + stopped_by
    if any(outcome.breaks_promise for outcome in outcomes):
        return ExitCode.VIOLATION
    return ExitCode.RUN_FAILED if any(outcome.failure for outcome in outcomes) else ExitCode.OK

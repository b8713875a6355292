"""`soter campaign`."""

from __future__ import annotations

import time
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from typer.core import TyperGroup

from soter.cli.exits import ExitCode, Force, StopSignals, complain, guard
from soter.cli.option import option, switch
from soter.cli.overrides import Settings, merge
from soter.cli.plain import emit
from soter.cli.recordings import RUNS
from soter.errors import ConfigError, option_error

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console

    from soter.campaign.plan import Campaign
    from soter.campaign.session import Totals
    from soter.campaign.store import RunRow, Store
    from soter.campaign.workers import Workers

EXAMPLES = """Examples:
  soter campaign examples/campaigns/thesis.toml
  soter campaign examples/campaigns/evaluation.toml --store evaluation.sqlite --jobs 8
  soter campaign examples/campaigns/faults.toml --list
Exit codes:
  0  every run was made, and all that is required holds
  1  what is required does not hold; without a requirement: ground truth counted a violation
  2  bad input: nothing was run
  3  a run failed, or was refused where none may be
  130  interrupted by Ctrl-C; finished runs are kept, the same command carries on
"""
AGAIN_EXAMPLES = """Examples:
  soter campaign run-again 3f2a91c07b5e --store runs/thesis.sqlite
Exit codes:
  0  it is the same run, bit for bit
  1  it is another one
  2  there is no such run
  3  it failed
"""
DRAW_EXAMPLES = """Examples:
  soter campaign draw 17
  soter campaign draw 17 --shrink --out small
Exit codes:
  0  it is written, or with --shrink: it does not fail
  1  with --shrink: it fails, and the smallest that does is written
  2  bad input
"""
_LINE_EVERY_S: Final = 10.0
_SHOWN: Final = 7


class _RunByDefault(TyperGroup):
    """A group whose default command is `run`, for a first argument that is a file."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ("--help", "-h"):
            args = ["run", *args]
        return super().parse_args(ctx, args)


campaign = typer.Typer(
    name="campaign",
    help="Run missions many times over seeds and settings, keep what came out, and say what follows.",
    cls=_RunByDefault,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

StoreFile = Annotated[
    Path | None, option("FILE.sqlite", "Where runs are kept; runs/NAME.sqlite if not given.", "--store")
]


@campaign.command(epilog=EXAMPLES)
def run(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="The campaign file (TOML).", show_default=False)],
    store: StoreFile = None,
    jobs: Annotated[int, option("N", "Runs at a time on this host.", min=1, max=1024)] = 2,
    cluster: Annotated[
        str | None, option("tls://HOST:PORT", "Run on the workers of this Dask scheduler instead.")
    ] = None,
    fresh: Annotated[bool, switch("--fresh", "Begin anew: what the store has is thrown away.")] = False,
    only: Annotated[str | None, option("PATTERN", "Only parts whose names match; it is no whole campaign.")] = None,
    settings: Settings = None,
    listed: Annotated[bool, switch("--list", "Print the runs' commands and run nothing.")] = False,
) -> None:
    """Run a campaign, or what is left of it: finished runs are kept, and never made again."""
    with guard():
        needs("scipy")
        from soter.campaign.plan import load_campaign
        from soter.campaign.store import Store
        from soter.campaign.tables import DRAWN
        from soter.cli.console import make_console

        read = load_campaign(file, merge({}, settings), only)
        needs(*["cma"] * any(part.search is not None for part in read.parts.values()))
        needs(*["shapely"] * any(part.mission == DRAWN for part in read.parts.values()))
        if listed:
            for part in read.parts.values():
                for job in () if part.search else read.jobs(part):
                    emit(f"{job.id}  {job.command}")
            return
        path = _new_store(store, file, fresh)
        console = make_console()
        with Store(path, write=True) as kept:
            about = _about(read)
            kept.describe({**about, "whole": ""})
            with StopSignals() as stop:
                _run(read, kept, _workers(jobs, cluster), stop, console)
            code = _sum_up(read, kept, console)
            if stop.received is None and only is None and not settings:
                kept.mark_whole()
            console.print(f"store: {path}", soft_wrap=True)
        if stop.received is not None:
            console.print("stopped; finished runs are kept, the same command carries on", soft_wrap=True)
            code = 128 + stop.received
        raise typer.Exit(code)


def needs(*libraries: str) -> None:
    """Check that the libraries of an extra are installed.

    Raises:
        ConfigError: one is missing; says what to install.
    """
    from soter.registry import install_hint

    for library in libraries:
        if find_spec(library) is None:
            hint = install_hint(library)
            raise ConfigError(f"it needs {library}, which is not installed; install it with: {hint}", key="campaign")


def _new_store(given: Path | None, file: Path, fresh: bool) -> Path:
    from soter.campaign.store import Store

    if given is None:
        try:
            RUNS.mkdir(exist_ok=True)
        except OSError as failure:
            raise option_error(
                "--store", f"it is not given, and no folder '{RUNS}' can be made here: {failure.strerror or failure}"
            ) from failure
        given = RUNS / f"{file.stem}.sqlite"
    if fresh and given.exists():
        # Opening it refuses a file that is no store, or one that is being written.
        Store(given, write=True).close()
        given.unlink()
    return given


def _about(campaign: Campaign) -> dict[str, str]:
    import platform

    from soter import __version__

    return {
        "path": str(campaign.path.resolve()), "title": campaign.title, "text": campaign.text,
        "sources": campaign.sources, "versions": f"soter {__version__}, Python {platform.python_version()}",
    }  # fmt: skip


def _workers(jobs: int, cluster: str | None) -> Workers:
    if cluster is None:
        from soter.campaign.workers import LocalWorkers

        return LocalWorkers(jobs)
    needs("distributed")
    from soter.campaign.cluster import ClusterWorkers

    return ClusterWorkers(cluster)


def _run(campaign: Campaign, store: Store, workers: Workers, stop: Callable[[], bool], console: Console) -> None:
    """Run the campaign, and show its progress."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from soter.campaign.session import run_campaign
    from soter.cli.console import is_live

    live = is_live(console)
    columns = (BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    shown_s = time.monotonic()
    with Progress(*columns, console=console, disable=not live) as progress:
        task = progress.add_task("", total=None)

        def changed(totals: Totals, row: RunRow | None) -> None:
            nonlocal shown_s
            progress.update(task, description=_words(totals), completed=totals.runs, total=totals.planned)
            if row is not None and row.status == "failed":
                progress.console.print(f"{row.id} failed: {row.failure}", soft_wrap=True, markup=False)
            if not live and (row is None or time.monotonic() - shown_s >= _LINE_EVERY_S):
                shown_s = time.monotonic()
                console.print(_words(totals), soft_wrap=True)

        run_campaign(campaign, store, workers, stop=stop, on_change=changed)


def _words(totals: Totals) -> str:
    """Return running totals in a line."""
    from soter.cli.progress import left_in_words, violations_in_words

    words = [f"{totals.runs} of {totals.planned} runs", f"{totals.robot_hours:.4g} robot-hours"]
    words.append(violations_in_words(dict(totals.violations)))
    if unguarded := totals.unguarded.total():
        words.append(f"{unguarded} of rules without a module")
    words += [f"{totals.status[status]} {status}" for status in ("refused", "failed") if totals.status[status]]
    if totals.left_s is not None:
        words.append(left_in_words(totals.left_s))
    return ", ".join(words)


def _sum_up(campaign: Campaign, store: Store, console: Console) -> int:
    """Print the results and return the exit code for them."""
    from rich.text import Text

    from soter.campaign.report.cells import cells
    from soter.campaign.summary import groups, judge
    from soter.cli.console import print_table
    from soter.sdk import RULES

    grouped = list(groups(store.rows()))
    found = [cells(group)[:_SHOWN] for group in grouped]
    rules = dict.fromkeys(rule for group in grouped for rule in group.rules()) or RULES
    # The other figures are in the store, and on the page of `soter campaign report`.
    head = ("part and setting", "runs", "robot-\nhours", "violations", "at most per\nrobot-hour", "AC\nshare")
    rows = [(f"{part} {setting}", runs.replace(", ", "\n"), *others) for part, setting, runs, *others in found]
    print_table(console, head, rows)
    console.print(f"violations: {' / '.join(rules)}", soft_wrap=True)
    judged = judge(campaign, store)
    for part, each in judged.items():
        for one in each:
            verdict = Text("holds", "green") if one.holds else Text("DOES NOT HOLD", "bold red")
            verdict = verdict if one.ran else Text("not run", "yellow")
            console.print(Text.assemble(f"{part}: {one.text}: {one.found}: ", verdict), soft_wrap=True)
    broken = [one for each in judged.values() for one in each if not one.holds]
    if not broken:
        return ExitCode.OK
    did_run = all(one.text not in ("no run fails", "no run is refused") for one in broken)
    return ExitCode.VIOLATION if did_run else ExitCode.RUN_FAILED


@campaign.command("run-again", epilog=AGAIN_EXAMPLES)
def run_again(
    run: Annotated[str, typer.Argument(metavar="ID", help="Which run: its id, or the beginning of it.")],
    store: Annotated[Path, option("FILE.sqlite", "The store of its campaign.")],
    record: Annotated[Path | None, option("FILE.mcap", "Record it.")] = None,
    force: Force = False,
) -> None:
    """Make one run of a campaign again, and prove by its trace that it is the same, bit for bit."""
    with guard():
        needs("scipy")
        from soter.campaign.again import find, job_of
        from soter.campaign.job import carry_out
        from soter.campaign.store import Store
        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs

        Outputs({"--record": record}, [store], force=force)
        console = make_console()
        with Store(store) as kept:
            row = find(kept, run)
            job = job_of(kept, row)
        console.print(job.command, soft_wrap=True, markup=False)
        with StopSignals() as stop:
            done = carry_out(job, stop, record)
        if stop.received is not None:
            raise typer.Exit(128 + stop.received)
        if done.status != row.status:
            complain(f"it was {row.status}, and is {done.status} now: {done.failure or done.trace}")
            raise typer.Exit(ExitCode.RUN_FAILED)
        again = (done.result or {}).get("trace_sha256", "")
        same = (done.result or {}) == row.result
        console.print(f"trace then  {row.trace_sha256}\ntrace now   {again}", markup=False)
        console.print("the same, bit for bit" if same else "it is another run")
        raise typer.Exit(ExitCode.OK if same else ExitCode.VIOLATION)


@campaign.command(epilog=DRAW_EXAMPLES)
def draw(
    seed: Annotated[int, typer.Argument(metavar="SEED", min=0, help="What everything is drawn from.")],
    out: Annotated[Path | None, option("DIR", "Where its files go; drawn-SEED here if not given.")] = None,
    engine: Annotated[str, option("kinematic|pybullet", "What moves the robots.")] = "kinematic",
    shrink: Annotated[bool, switch("--shrink", "Make it smaller for as long as it fails.")] = False,
    duration: Annotated[float | None, option("SECONDS", "With --shrink: in place of what is drawn.", min=1.0)] = None,
    force: Force = False,
) -> None:
    """Write the configuration that a seed draws, as the part `random` of a campaign runs it; or what of it fails."""
    with guard():
        needs("shapely")
        from soter.campaign.random.drawing import draw as draw_configuration
        from soter.cli.outputs import refuse_clashes

        if engine not in ("kinematic", "pybullet"):
            raise option_error("--engine", f"it is '{engine}', allowed: kinematic, pybullet")
        folder = out or Path(f"drawn-{seed}")
        refuse_clashes({"--out": folder / "mission.toml"}, force=force)
        if not shrink:
            emit(str(draw_configuration(seed, engine).write(folder)))
            return
        from soter.campaign.random.shrinking import shrink as make_smaller

        mission = make_smaller(seed, engine, folder, duration, emit)
        if mission is not None:
            emit(str(mission))
            raise typer.Exit(ExitCode.VIOLATION)

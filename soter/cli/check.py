"""`soter check`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Any

import typer

from soter.cli.complete import missions
from soter.cli.exits import ExitCode, Force, guard
from soter.cli.option import option, switch
from soter.cli.overrides import Promising, Settings, load_with_engine, merge
from soter.errors import ConfigError, option_error

if TYPE_CHECKING:
    from rich.console import Console

    from soter.check.bench import ModuleBench
    from soter.check.falsify import Falsified
    from soter.check.mission import MissionReport
    from soter.check.trial import Attempt, Counterexample
    from soter.cli.outputs import Outputs
    from soter.config import MissionFile

EXAMPLES = """Examples:
  soter check examples/surveillance.toml
  soter check examples/thesis.toml --json -
  soter check module:examples.modules.too_late:declare --counterexample found.json
  soter check --replay found.json --picture found.png
Exit codes:
  0  no condition is rejected, and no proof has a gap, or --allow-gaps says that it may
  1  a condition is rejected, or is PARTLY proved: not for every state
  2  bad input, or a backend that cannot be used here
"""

_PREFIX = "module:"
_OPTIONS = "options."
_KEYS = ("delta_s", "model", "phi_safe_m", "phi_safer_m", "phi_safer_inset_m")


def check(
    target: Annotated[
        str | None,
        typer.Argument(
            metavar="MISSION|module:NAME",
            help="A mission file, or a module of your own as module:package.module:name.",
            show_default=False,
            autocompletion=missions,
        ),
    ] = None,
    backend: Promising = None,
    settings: Settings = None,
    budget: Annotated[int, option("N", "Trials for a module that is tested.", min=2)] = 200,
    seed: Annotated[int, option("N", "Everything random is drawn from it.", min=0)] = 0,
    robots: Annotated[
        int | None,
        option(
            "N", "Robots in the trials of module:NAME; by default 2 if its rule is about pairs, else 1.", min=1, max=8
        ),
    ] = None,
    patience: Annotated[float, option("SECONDS", "Time to come back, with module:NAME.", min=0.1, max=3600.0)] = 60.0,
    allow_gaps: Annotated[
        bool, switch("--allow-gaps", "Exit with 0 although a proof has a gap, if nothing is rejected.")
    ] = False,
    counterexample: Annotated[Path | None, option("FILE", "Write the first counterexample, to be replayed.")] = None,
    replay: Annotated[Path | None, option("FILE", "Run a counterexample again, and say where it breaks.")] = None,
    json: Annotated[Path | None, option("FILE", "Write the findings; - is standard output.")] = None,
    picture: Annotated[Path | None, option("FILE.png", "Draw the first counterexample.")] = None,
    force: Force = False,
) -> None:
    """Check whether safety modules are well-formed: P1 and P3, proofs of P2 for one robot, and trials.

    A proof covers all states, under the assumptions that docs/writing-a-module.md lists. Several robots at once are
    tested, not proved: the first four of the mission.
    """
    with guard():
        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs, as_json, unwritten
        from soter.stack.modules import BUILT_IN

        if (target is None) == (replay is None):
            raise ConfigError("say what to check: a mission file, module:NAME, or --replay FILE, one of them")
        outputs = {"--json": json, "--picture": picture, "--counterexample": counterexample}
        files = Outputs(outputs, [Path(read) for read in (target, replay) if read is not None], force=force)
        console = make_console(stderr=files.to_stdout)
        if replay is not None:
            raise typer.Exit(_replay(console, replay, files))
        assert target is not None
        subject: dict[str, Any] = {"target": target, "backend": backend, "settings": list(settings or ())}
        report = _check(console, subject, robots, patience, budget, seed)
        _print(console, report)
        # Nothing is known of what would do for a rejected module of the user's own.
        if any(each.verdict.value == "REJECTED" and each.module in BUILT_IN for each in report.findings):
            _print_what_would_do(console, subject)
        if counterexample is not None:
            with unwritten("the counterexample"):
                _write_example(console, report, subject, files, counterexample)
        with unwritten("the findings"):
            files.write("--json", lambda: as_json(_content(report, target)))
            files.write("--picture", lambda: _picture(report, target))
        fine = not report.rejected and (report.complete or allow_gaps)
        raise typer.Exit(ExitCode.OK if fine else ExitCode.VIOLATION)


def _check(
    console: Console, subject: dict[str, Any], robots: int | None, patience_s: float, budget: int, seed: int
) -> MissionReport:
    from soter.check.mission import check_mission, check_module
    from soter.cli.console import is_live
    from soter.runner.hosts import check_acs

    status = console.status("")
    if is_live(console):
        status.start()
    try:
        if subject["target"].startswith(_PREFIX):
            return check_module(_own_module(subject, robots, patience_s), budget, seed, status.update)
        mission = _mission(subject)
        check_acs(mission)
        return check_mission(mission, budget, seed, status.update)
    finally:
        status.stop()


def _mission(subject: dict[str, Any]) -> MissionFile:
    return load_with_engine(Path(subject["target"]), merge({"backend": subject["backend"]}, subject["settings"]))


def _own_module(subject: dict[str, Any], robots: int | None, patience_s: float) -> ModuleBench:
    from soter.check.bench import floor_bench
    from soter.loading import find_from_here

    if subject["backend"] is not None:
        raise option_error("--backend", "modules of your own are tried on simulated robots")
    find_from_here()
    options = merge({}, subject["settings"])
    if wrong := [key for key in options if not key.startswith(_OPTIONS)]:
        raise option_error(
            wrong[0], f"a module without a mission has its own options only, written as {_OPTIONS}KEY=VALUE"
        )
    given = {key.removeprefix(_OPTIONS): value for key, value in options.items()}
    return floor_bench(subject["target"].removeprefix(_PREFIX), given, robots, patience_s)


_STYLES = {"PROVED": "green", "PARTLY": "yellow", "TESTED": "cyan", "ASSUMED": "yellow", "REJECTED": "bold red"}


def _print(console: Console, report: MissionReport) -> None:
    from rich.text import Text

    width = max((len(each.module) for each in report.findings), default=0)
    for each in report.findings:
        verdict = each.verdict.value
        head = (f"{each.module:<{width}}  {each.condition:<3}  ", (f"{verdict:<8}", _STYLES[verdict]))
        text = each.text
        if console.file.isatty():  # indented below its own start; in files and pipes, each finding is one line
            begins = width + len("  P2a  REJECTED  ")
            text = f"\n{'':{begins}}".join(wrap(text, max(console.width - begins, 20)))
        console.print(Text.assemble(*head, f"  {text}"), soft_wrap=True)
    counts = Counter(each.verdict.value for each in report.findings)
    summary = ", ".join(f"{counts[verdict]} {verdict}" for verdict in _STYLES if verdict in counts)
    console.print(Text(f"\n{summary}", "bold red" if report.rejected else "bold"), soft_wrap=True)


def _print_what_would_do(console: Console, subject: dict[str, Any]) -> None:
    """Print tables with numbers that would do for all modules that keep distances, or why there are none."""
    from soter.check.tune import what_would_do
    from soter.config.toml_text import toml

    try:
        tuning = what_would_do(_mission(subject))
    except ConfigError as failure:
        console.print(f"\nwhat would do does not fit in the workspace: {failure}", soft_wrap=True)
        return
    if tuning.refused:
        console.print(
            "\nno numbers of these modules would do for robots that promise so much; the nearest:", soft_wrap=True
        )
        for each in tuning.refused:
            console.print(f"{each.module}  {each.condition}  {each.text}", soft_wrap=True)
        return
    tables = tuning.tables()["rta"]
    shown = {name: {key: tables[name][key] for key in _KEYS if key in tables[name]} for name in tuning.trade}
    console.print("\nall of these together would do:", soft_wrap=True)
    console.print(toml({"rta": shown}).rstrip(), soft_wrap=True, markup=False, highlight=False)


def _content(report: MissionReport, target: str) -> dict[str, Any]:
    return {
        "format": "soter-check",
        "target": target,
        "rejected": report.rejected,
        "findings": [each.as_dict() for each in report.findings],
    }


def _first(report: MissionReport) -> tuple[str, Falsified] | None:
    """Return the first counterexample, with its module."""
    return next(((name, each) for name, broken in report.counterexamples.items() for each in broken), None)


def _picture(report: MissionReport, target: str) -> bytes:
    if (found := _first(report)) is not None:
        return _drawn(report.benches[found[0]], found[1].trial, target)
    from soter.record.tracks import RunTracks
    from soter.report.caption import Caption
    from soter.report.picture import draw_png

    caption = Caption(title=target, figures=("no counterexample was found",), alarming=report.rejected)
    return draw_png(RunTracks(report.workspace, (), {}), caption)


def _drawn(bench: ModuleBench, trial: Attempt, title: str) -> bytes:
    from soter.cli.trial_picture import draw_trial

    return draw_trial(bench.workspace, trial, bench.module, title)


def _write_example(
    console: Console, report: MissionReport, subject: dict[str, Any], files: Outputs, path: Path
) -> None:
    from soter.check.trial import Counterexample, trace_hash

    if (found := _first(report)) is None:
        console.print("no counterexample was found, so none is written", soft_wrap=True)
        return
    (name, falsified), bench = found, report.benches[found[0]]
    tried = {**subject, "module": name, "robots": bench.robots, "patience_s": bench.patience_s}
    breach, trial = falsified.breach, falsified.trial
    example = Counterexample(
        tried, breach.obligation, breach.time_s, breach.text, falsified.vector, trace_hash(trial)
    )  # fmt: skip
    files.write("--counterexample", f"{example.as_json(trial.rows)}\n".encode)
    console.print(f"counterexample: {path}; run it again with: soter check --replay {path}", soft_wrap=True)


def _replay(console: Console, path: Path, files: Outputs) -> ExitCode:
    """Run a counterexample again; return 1 if it breaks the same condition as before."""
    from soter.check.trial import read_counterexample, trace_hash
    from soter.cli.outputs import as_json, unwritten

    example = read_counterexample(path)
    bench = _bench_of(example, path)
    if len(example.vector) != bench.dimensions:
        raise _not_replayable(path, f"its point has {len(example.vector)} numbers, and {bench.dimensions} are needed")
    trial = bench.run(example.vector)
    broken = next((each for each in trial.breaches if each.obligation is example.obligation), None)
    same = trace_hash(trial) == example.trace_sha256
    if broken is None:
        console.print(f"{example.obligation.value} is not broken any more; it was: {example.text}", soft_wrap=True)
    else:
        console.print(f"{broken.obligation.value} is broken again: {broken.obligation.statement}", soft_wrap=True)
        console.print(broken.text, soft_wrap=True)
        console.print("the trace is the same, bit for bit" if same else "the trace differs", soft_wrap=True)
    with unwritten("it"):
        found = {"broken": broken is not None, "same_trace": same, "text": "" if broken is None else broken.text}
        files.write("--json", lambda: as_json(found))
        files.write("--picture", lambda: _drawn(bench, trial, f"replay of {path}"))
    return ExitCode.OK if broken is None else ExitCode.VIOLATION


def _bench_of(example: Counterexample, path: Path) -> ModuleBench:
    from soter.check.bench import ModuleBench

    tried = dict(example.subject)
    try:
        subject = {key: tried[key] for key in ("target", "backend", "settings")}
        name, robots, patience_s = str(tried["module"]), int(tried["robots"]), float(tried["patience_s"])
        if not isinstance(subject["target"], str) or not isinstance(subject["settings"], list):
            raise TypeError("target has to be a text and settings a list")
    except (KeyError, TypeError, ValueError) as failure:
        raise _not_replayable(path, f"what was tried cannot be read: {failure!r}") from failure
    if subject["target"].startswith(_PREFIX):
        return _own_module(subject, robots, patience_s)
    mission = _mission(subject)
    return ModuleBench(mission, mission.read_workspace(), name, robots, patience_s)


def _not_replayable(path: Path, why: str) -> ConfigError:
    return ConfigError(f"{why}; it is from another version, or was changed", source=str(path))

"""`soter info`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from soter.cli.exits import Force, guard
from soter.cli.option import option, switch
from soter.cli.overrides import RecordingArgument
from soter.cli.plain import emit
from soter.errors import option_error

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.record.looks import Stall
    from soter.record.summary import AssumptionFailure, Summary

EXAMPLES = """Examples:
  soter info run.mcap
  soter info run.mcap --json
  soter info run.mcap --csv tables
Exit codes:
  0  the recording was read, to its end or to where it was cut off
  2  it is no recording, or damaged
"""


def info(
    recording: RecordingArgument,
    json: Annotated[bool, switch("--json", "Print it as JSON.")] = False,
    csv: Annotated[Path | None, option("FOLDER", "Write everything into CSV files there.")] = None,
    force: Force = False,
) -> None:
    """Say what a recording holds."""
    with guard():
        from dataclasses import asdict
        from json import dumps

        from soter.cli.console import make_console
        from soter.cli.outputs import refuse_clashes
        from soter.record.export import csv_files, export_csv
        from soter.record.reader import Recording
        from soter.record.summary import summarise

        opened = Recording(recording)
        if csv is not None:
            refuse_clashes({"--csv": next((each for each in csv_files(csv) if each.exists()), None)}, force=force)
        summary = summarise(opened, opened.content())
        console = make_console()
        if json:
            emit(dumps(asdict(summary), indent=2))
        else:
            for name, value in _lines(summary):
                console.print(f"{name:<15} {value}", soft_wrap=True, markup=False)
        if csv is not None:
            try:
                written = export_csv(opened, csv)
            except OSError as failure:
                why = failure.strerror or failure
                raise option_error("--csv", f"'{csv}' cannot be written: {why}") from failure
            if not json:
                console.print(f"{'tables':<15} {len(written)} files in {csv}", soft_wrap=True)


def _lines(summary: Summary) -> list[tuple[str, str]]:
    time = "virtual time" if summary.virtual_time else "wall clock"
    state = "cut off: what follows is what there is" if summary.truncated else "whole"
    lines = [
        ("recording", f"{summary.file}, {summary.size_bytes / 1e6:.1f} MB, {state}"),
        ("digest", summary.digest),
        ("run", f"{summary.mission or 'a mission made in code'} on {summary.backend}, {time}, seed {summary.seed}"),
        ("started", summary.started_utc),
        ("duration", f"{summary.duration_s:g} s, {summary.ticks} ticks"),
        ("ended", summary.status or "unknown: it did not get to say so"),
        ("robots", ", ".join(map(str, summary.robots))),
        ("modules", ", ".join(summary.modules) or "none"),
        ("AC in control", f"{100.0 * summary.ac_share:.1f} %"),
        ("disengagements", _counts(summary.disengagements)),
        ("switches", str(summary.switches)),
        ("goals", _counts(summary.goals)),
        ("targets", _counts(summary.targets)),
        ("transitions", str(summary.transitions)),
        ("violations", _judged(summary)),
    ]
    if summary.faults:
        lines.append(("faults", _counts(summary.faults)))
    lines += _labelled("assumptions", [_failed(each) for each in summary.assumptions])
    lines += _labelled("stalls", [_stall(each) for each in summary.stalls])
    lines += _labelled("never moved", [f"robot {robot}" for robot in summary.never_moved])
    lines += _labelled("not proved", [f"{text} (accepted)" for text in summary.accepted_unproved])
    if summary.dropped_ticks:
        lines.append(("dropped", f"{summary.dropped_ticks} ticks: the writer did not follow"))
    lines.append(("versions", ", ".join(f"{name} {version}" for name, version in summary.versions.items())))
    return lines


def _labelled(name: str, texts: list[str]) -> list[tuple[str, str]]:
    return [("" if index else name, text) for index, text in enumerate(texts)]


def _failed(failed: AssumptionFailure) -> str:
    from soter.cli.summary import breach_text

    until = "" if failed.last_s is None or failed.times == 1 else f", last at {failed.last_s:.2f} s"
    text = breach_text(failed.times, failed.first_s, failed.cause, failed.worst)
    return f"{failed.assumption} failed for robot {failed.robot_id} {text}{until}"


def _stall(stall: Stall) -> str:
    end = "the end" if stall.end_s is None else f"{stall.end_s:.2f} s"
    why = ": ".join(filter(None, (stall.module, stall.cause)))
    return f"robot {stall.robot_id} without its AC from {stall.start_s:.2f} s to {end}: {why}"


def _judged(summary: Summary) -> str:
    counts = _counts(summary.violations)
    if not summary.unknown:
        return counts
    # No recorded violation does not mean none if ground truth did not judge the whole run.
    return f"{counts} as far as is known: {summary.unknown}" if summary.violations else f"unknown: {summary.unknown}"


def _counts(counts: Mapping[str, int]) -> str:
    total = sum(counts.values())
    return f"{total} ({', '.join(f'{name} {count}' for name, count in counts.items())})" if counts else "0"

"""`soter replay`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli.exits import ExitCode, guard
from soter.cli.option import option, switch
from soter.cli.overrides import RecordingArgument, merge
from soter.cli.plain import emit

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console

    from soter.replay.replay import Replay

EXAMPLES = """Examples:
  soter replay run.mcap
  soter replay run.mcap --set rta.collision.delta_s=0.2
Exit codes:
  0  every decision is what was recorded; with --set: the question is answered, whatever the answer is
  1  something differs, or was changed after it had been written
  2  no recording, a damaged one, or one with gaps; or a setting that is not allowed
"""

SHOWN = 20


def replay(
    recording: RecordingArgument,
    settings: Annotated[
        list[str] | None,
        option(
            "KEY=VALUE",
            "Ask what the modules would have decided: another value of a key below rta or battery; may be repeated.",
            "--set",
        ),
    ] = None,
    json: Annotated[bool, switch("--json", "Print what was found as JSON.")] = False,
) -> None:
    """Let the decision modules decide again on what a recording says they knew, and compare.

    It is open loop: with other settings the robots still do what they did then, whatever the modules say.
    """
    with guard():
        from json import dumps

        from soter.cli.console import make_console
        from soter.record.digest import DigestState
        from soter.record.reader import Recording
        from soter.replay.replay import replay as play

        opened = Recording(recording)
        found = play(opened, merge({}, settings))
        if json:
            emit(dumps(_plain(found), indent=2, default=str))
        else:
            if opened.proof is not None and opened.proof.state is DigestState.NONE:
                make_console().print(f"{recording}: {opened.proof.why}", soft_wrap=True, markup=False)
            _show(make_console(), recording, found)
        raise typer.Exit(_exit_code(found))


def _exit_code(found: Replay) -> ExitCode:
    # Differences are expected with other settings; changed records never are.
    if found.flaws or not (found.same or found.settings):
        return ExitCode.VIOLATION
    return ExitCode.BAD_INPUT if found.gap_s is not None or not found.ticks else ExitCode.OK


def _plain(found: Replay) -> dict[str, object]:
    values: dict[str, object] = {"same": found.same}
    for name in found.__slots__:
        value = getattr(found, name)
        rows = isinstance(value, list) and value and isinstance(value[0], tuple)
        values[name] = [each._asdict() for each in value] if rows else value
    return values


def _show(console: Console, file: Path, found: Replay) -> None:
    def say(text: str) -> None:
        console.print(text, soft_wrap=True, markup=False)

    say(f"{file}: {found.ticks} ticks, {found.duration_s:g} s replayed")
    if found.truncated:
        say("The recording was cut off; this is as far as it goes.")
    if found.gap_s is not None:
        say(f"Ticks are missing before {found.gap_s:.2f} s; what comes after them cannot be compared.")
    for wrong in found.flaws[:SHOWN]:
        say(f"changed after it was written: {wrong.time_s:.3f} s, robot {wrong.robot_id}")
    if len(found.flaws) > SHOWN:
        say(f"... {len(found.flaws) - SHOWN} more records were changed")
    if found.settings:
        _show_question(say, found)
    elif found.differing:
        for each in found.differences[:SHOWN]:
            say(
                f"differs: {each.time_s:.3f} s, robot {each.robot_id}, {each.field}: recorded {each.recorded}, "
                f"replayed {each.replayed}"
            )
        if found.differing > SHOWN:
            say(f"... {found.differing - SHOWN} more values differ")
    elif found.same and found.ticks:
        say("Every decision is what was recorded, bit by bit.")


def _show_question(say: Callable[[str], None], found: Replay) -> None:
    for refusal in found.ill_formed:
        say(f"A run would be refused: {refusal}")
    for spell in found.spells[:SHOWN]:
        say(
            f"{spell.start_s:.2f} to {spell.end_s:.2f} s, robot {spell.robot_id}: {spell.replayed} drives, "
            f"{spell.recorded} did"
        )
    if len(found.spells) > SHOWN:
        say(f"... {len(found.spells) - SHOWN} more times")
    for module in sorted({*found.before, *found.after}):
        say(f"disengagements by {module}: {found.before[module]} recorded, {found.after[module]} replayed")
    say(f"disengagements: {found.before.total()} recorded, {found.after.total()} replayed")
    say(
        "Open loop: the robots do what they did then, whatever the modules tell them now. After the first difference "
        "a run would have gone another way."
    )

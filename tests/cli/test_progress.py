"""What is shown while a mission runs."""

from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from soter.cli.progress import (
    LINE_EVERY_S,
    LineDisplay,
    LiveDisplay,
    frame,
    least_margin,
    left,
    line,
    make_display,
    margin_in_words,
    violations_in_words,
)
from soter.runner import Progress, RobotProgress

NONE = {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}


def robot(robot_id: int, driver: str = "AC", battery: float | None = 0.5) -> RobotProgress:
    """A robot at work."""
    cause = "" if driver == "AC" else "margin 0.100 m < reach 0.120 m"
    margins = {"collision": math.inf, "obstacle": 0.4, "geofence": 0.25, "battery": 0.31}
    return RobotProgress(robot_id, 1.0, 1.0, driver, cause, battery, margins, 7, 3)


def progress(*robots: RobotProgress, wall_s: float = 12.0, violations: dict[str, int] | None = NONE) -> Progress:
    """A run after two minutes."""
    return Progress(120.0, 600.0, wall_s, robots, violations)


def drawn(shown: Progress, width: int, height: int = 24) -> list[str]:
    """The live display as lines of text."""
    console = Console(file=io.StringIO(), width=width, height=height)
    with console.capture() as capture:
        console.print(frame(shown, width, height))
    return capture.get().splitlines()


@pytest.mark.parametrize("width", [80, 120, 200])
def test_every_robot_is_shown_with_all_that_matters(width: int) -> None:
    lines = drawn(progress(robot(1), robot(2, "geofence", 0.17)), width)
    text = "\n".join(lines)
    assert max(map(len, lines)) <= width
    for expected in ("AC", "geofence: margin", "50 %", "17 %", "0.25 m", "120 of 600 s", "10.0 x real time",
                     "no violation"):  # fmt: skip
        assert expected in text


@pytest.mark.parametrize("width", [50, 60, 79])
def test_a_narrow_terminal_still_says_who_drives(width: int) -> None:
    lines = drawn(progress(robot(1), robot(2, "geofence", 0.17)), width)
    assert max(map(len, lines)) <= width
    assert any("driven by" in line for line in lines)
    assert any("geofence:" in line for line in lines)


def test_it_says_how_much_is_left_once_that_can_be_known() -> None:
    assert left(progress(robot(1), wall_s=1.0)) == ""
    assert left(progress(robot(1), wall_s=12.0)) == "about 48 s left"
    assert left(progress(robot(1), wall_s=120.0)) == "about 8 min left"
    assert "about 48 s left" in line(progress(robot(1), wall_s=12.0))


def test_a_wide_terminal_shows_every_margin_and_the_whole_cause() -> None:
    text = "\n".join(drawn(progress(robot(1, "obstacle")), 160))
    for expected in ("obstacle: margin 0.100 m < reach 0.120 m", "far", "0.40 m", "0.25 m", "31 %"):
        assert expected in text


@pytest.mark.parametrize("width", [45, 80, 160])
def test_a_robot_that_its_ac_has_not_had_yet_is_starting(width: int) -> None:
    text = "\n".join(drawn(progress(robot(1)._replace(driver="starting")), width))
    assert "starting" in text
    assert "starting:" not in text


def test_what_does_not_fit_on_the_terminal_is_counted() -> None:
    robots = [robot(index, "AC" if index % 2 else "battery") for index in range(1, 65)]
    lines = drawn(progress(*robots), 80, height=20)
    assert len(lines) < 20
    assert any("and 52 more robots, 26 of them in AC" in line for line in lines)


def test_unknown_charge_and_no_modules_are_shown() -> None:
    bare = RobotProgress(1, 0.0, 0.0, "AC", "", None, {}, 0, 0)
    for width in (80, 160):
        assert "unknown" in "\n".join(drawn(progress(bare), width))


def test_violations_in_words() -> None:
    assert violations_in_words(None) == "violations unknown: no ground truth"
    assert violations_in_words(NONE) == "no violation"
    assert violations_in_words({**NONE, "collision": 2, "battery": 1}) == "violations: 1 battery, 2 collision"


@pytest.mark.parametrize(
    ("module", "margin", "words"),
    [
        ("geofence", 0.256, "0.26 m"),
        ("battery", 0.256, "26 %"),
        ("collision", math.inf, "far"),
        ("collision", math.nan, "-"),
        ("collision", -math.inf, "-"),
    ],
)
def test_margins_in_words(module: str, margin: float, words: str) -> None:
    assert margin_in_words(module, margin) == words


def test_the_least_margin_is_one_of_the_distances() -> None:
    assert least_margin(robot(1)) == "geofence 0.25 m"
    assert least_margin(robot(1)._replace(margins={"battery": 0.2})) == "battery 20 %"
    assert least_margin(robot(1)._replace(margins={"collision": math.nan})) == "-"


def test_a_line_says_who_drives() -> None:
    assert line(progress(robot(1), robot(2, "battery", 0.17))) == (
        "120 of 600 s, 10.0 x real time, about 48 s left, no violation; robot 1: AC, charge 50 %, "
        "robot 2: battery, charge 17 %"
    )


def test_lines_come_every_so_often() -> None:
    console = Console(file=(file := io.StringIO()), width=40)
    with LineDisplay(console, "m.toml") as display:
        for tenth in range(300):
            display.update(progress(robot(1), wall_s=tenth / 10.0))
    first, *lines = file.getvalue().splitlines()
    assert first == "running m.toml; Ctrl-C stops the robots"
    assert len(lines) == int(30.0 / LINE_EVERY_S) - 1


def test_only_a_terminal_gets_a_live_display(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("TERM", "xterm")
    assert isinstance(make_display(Console(file=Terminal()), "m"), LiveDisplay)
    # FORCE_COLOR asks for colours, not for a display that overwrites itself.
    assert isinstance(make_display(Console(file=io.StringIO(), force_terminal=True), "m"), LineDisplay)
    monkeypatch.setenv("TERM", "dumb")
    assert isinstance(make_display(Console(file=Terminal()), "m"), LineDisplay)


def test_the_live_display_leaves_nothing_behind() -> None:
    console = Console(file=(file := io.StringIO()), width=80, height=24, force_terminal=True)
    with LiveDisplay(console) as display:
        display.update(progress(robot(1)))
    text = file.getvalue()
    assert "driven by" in text
    assert text.endswith("\x1b[2K")

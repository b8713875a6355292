"""The display of `soter run` while a mission runs: a live table on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Final, Self

from rich import box
from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from soter.cli.console import is_live

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from soter.runner import Progress, RobotProgress

LINE_EVERY_S: Final = 10.0
"""Host time between two lines if the display cannot be live."""

UNTRIED: Final = "--accept-unproved does without"

SURE_S: Final = 2.0
"""Host time after which the remaining time is shown."""

MIDDLE_COLUMNS: Final = 80
"""Below this width charges and targets have no column, so that there is room for the driver's."""

WIDE_COLUMNS: Final = 104
"""From this width on every module's margin has a column of its own."""

DRIVER_STYLES: Final = {"AC": "blue", "starting": "dim"}
MODULE_STYLES: Final = {"collision": "red", "obstacle": "magenta", "geofence": "yellow", "battery": "green"}


def make_display(console: Console, name: str) -> LiveDisplay | LineDisplay:
    """Return the display that suits a console; `name` is the mission's."""
    return LiveDisplay(console) if is_live(console) else LineDisplay(console, name)


def speed(progress: Progress) -> str:
    """Return the speed of the run, in words."""
    return f"{progress.time_s / progress.wall_s:.1f} x real time" if progress.wall_s > 0.0 else ""


def left(progress: Progress) -> str:
    """Return an estimate of the remaining host time, in words; empty while it is unknown."""
    if progress.time_s <= 0.0 or progress.wall_s < SURE_S:
        return ""
    return left_in_words((progress.duration_s - progress.time_s) * progress.wall_s / progress.time_s)


def left_in_words(left_s: float) -> str:
    """Return the remaining host time in words."""
    if left_s < 100.0:
        return f"about {left_s:.0f} s left"
    return f"about {left_s / 60.0:.0f} min left" if left_s < 6000.0 else f"about {left_s / 3600.0:.1f} h left"


def violations_in_words(violations: dict[str, int] | None) -> str:
    """Return the violations that ground truth has counted, in words."""
    if violations is None:
        return "violations unknown: no ground truth"
    counted = [f"{count} {rule}" for rule, count in violations.items() if count]
    return f"violations: {', '.join(counted)}" if counted else "no violation"


def margin_in_words(module: str, margin: float) -> str:
    """Return a margin with its unit: the battery's is charge, the others' are metres."""
    if not math.isfinite(margin):
        return "-" if math.isnan(margin) or margin < 0.0 else "far"
    return f"{margin * 100.0:.0f} %" if module == "battery" else f"{margin:.2f} m"


def least_margin(robot: RobotProgress) -> str:
    """Return a robot's least margin with its module; of the margins in metres if there are any."""
    known = {module: margin for module, margin in robot.margins.items() if not math.isnan(margin)}
    distances = {module: margin for module, margin in known.items() if module != "battery"} or known
    if not distances:
        return "-"
    module = min(distances, key=distances.__getitem__)
    return f"{module} {margin_in_words(module, distances[module])}"


class LineDisplay:
    """A plain line once robots move, and every `LINE_EVERY_S` of host time."""

    def __init__(self, console: Console, name: str) -> None:
        self._console: Final = console
        self._name: Final = name
        self._next_s = self._next_try_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def trying(self, text: str) -> None:
        """Print what is tried before the run, if a line is due."""
        if time.monotonic() >= self._next_try_s:
            self._next_try_s = time.monotonic() + LINE_EVERY_S
            self._console.print(f"before it runs, {text}; {UNTRIED}", soft_wrap=True)

    def update(self, progress: Progress) -> None:
        """Print a line if one is due."""
        if not self._next_s:
            # The first update means that the robots are ready; before, the mission may still be refused.
            self._console.print(f"running {self._name}; Ctrl-C stops the robots", soft_wrap=True)
            self._next_s = LINE_EVERY_S
        if progress.wall_s >= self._next_s:
            self._next_s = progress.wall_s + LINE_EVERY_S
            self._console.print(line(progress), soft_wrap=True)


def line(progress: Progress) -> str:
    """Return a run's progress as one line."""
    robots = ", ".join(_robot_in_words(robot) for robot in progress.robots)
    far = (f"{progress.time_s:.0f} of {progress.duration_s:.0f} s", speed(progress), left(progress))
    return f"{', '.join(filter(None, far))}, {violations_in_words(progress.violations)}; {robots}"


def _robot_in_words(robot: RobotProgress) -> str:
    charge = "" if robot.battery is None else f", charge {100.0 * robot.battery:.0f} %"
    return f"robot {robot.robot_id}: {robot.driver}{charge}"


class LiveDisplay:
    """A table of the robots that is redrawn in place.

    It draws in `update()` only, so that it needs no thread and cannot delay a tick.
    """

    def __init__(self, console: Console) -> None:
        self._console: Final = console
        # The table vanishes when the run has ended, and the summary remains.
        self._live: Final = Live(console=console, auto_refresh=False, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def trying(self, text: str) -> None:
        """Show what is tried before the run."""
        self._live.update(Text(f"before it runs, {text}; {UNTRIED}", "dim"), refresh=True)

    def update(self, progress: Progress) -> None:
        """Draw anew."""
        picture = frame(progress, self._console.width, self._console.height)
        self._live.update(picture, refresh=True)


def frame(progress: Progress, width: int, height: int) -> RenderableType:
    """Return the live display for a terminal of a size in characters."""
    # The table's head and foot take four lines, the lines below it and the cursor's line three.
    room = max(2, height - 7)
    shown = progress.robots if len(progress.robots) <= room else progress.robots[: room - 1]
    hidden = len(progress.robots) - len(shown)
    parts: list[RenderableType] = [_robot_table(shown, width)]
    if hidden:
        in_ac = sum(robot.driver == "AC" for robot in progress.robots[len(shown) :])
        parts.append(Text(f"and {hidden} more robots, {in_ac} of them in AC", "dim"))
    style = "bold red" if any((progress.violations or {}).values()) else ""
    parts += [_bar_line(progress, width), Text(violations_in_words(progress.violations), style, no_wrap=True)]
    return Group(*parts)


def _robot_table(robots: tuple[RobotProgress, ...], width: int) -> Table:
    modules = list(robots[0].margins) if robots else []
    wide, narrow = width >= WIDE_COLUMNS, width < MIDDLE_COLUMNS
    columns = modules if wide and modules else ["least margin"]
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, expand=True)
    table.add_column("robot" if not narrow else "", justify="right", no_wrap=True)
    table.add_column("driven by", no_wrap=True, overflow="ellipsis", ratio=1, min_width=10)
    if not narrow:
        table.add_column("charge", no_wrap=True, min_width=12)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True, min_width=7 if wide else 16)
    if not narrow:
        table.add_column("targets", justify="right", no_wrap=True)
    table.add_column("AC>SC", justify="right", no_wrap=True)
    for robot in robots:
        margins = [margin_in_words(module, robot.margins.get(module, math.nan)) for module in modules]
        table.add_row(
            str(robot.robot_id),
            _driver(robot),
            *([] if narrow else [_charge_bar(robot.battery)]),
            *(margins if columns is modules else [least_margin(robot)]),
            *([] if narrow else [str(robot.targets_reached)]),
            str(robot.disengagements),
        )
    return table


def _driver(robot: RobotProgress) -> Text:
    if robot.driver in DRIVER_STYLES:
        return Text(robot.driver, DRIVER_STYLES[robot.driver])
    style = f"bold {MODULE_STYLES.get(robot.driver, 'red')}"
    return Text.assemble((robot.driver, style), f": {robot.cause}" if robot.cause else "")


def _charge_bar(charge: float | None) -> RenderableType:
    if charge is None:
        return Text("unknown", "dim")
    style = "red" if charge < 0.2 else "yellow" if charge < 0.5 else "green"
    row = Table.grid(padding=(0, 1, 0, 0))
    row.add_row(ProgressBar(1.0, min(max(charge, 0.0), 1.0), width=6, complete_style=style, finished_style=style),
                Text(f"{100.0 * charge:3.0f} %"))  # fmt: skip
    return row


def _bar_line(progress: Progress, width: int) -> RenderableType:
    row = Table.grid(padding=(0, 2, 0, 0))
    row.add_row(
        ProgressBar(progress.duration_s, progress.time_s, width=30 if width >= MIDDLE_COLUMNS else 10),
        Text(f"{progress.time_s:.0f} of {progress.duration_s:.0f} s"),
        Text(speed(progress)),
        Text(left(progress)),
    )
    return row

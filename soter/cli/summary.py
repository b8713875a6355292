"""The summary of `soter run`: the run's figures, on request beside those of the thesis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Final, NamedTuple

from rich import box
from rich.table import Table
from rich.text import Text

from soter.runner.result import THESIS_AC_SHARE, THESIS_DISENGAGEMENTS

if TYPE_CHECKING:
    from rich.console import Console

    from soter.report.caption import Caption, Rule
    from soter.runner import RunResult

THESIS_DURATION_S: Final = 7200.0
THESIS_ROBOTS: Final = 2
THESIS_TARGETS: Final = "grid"
THESIS_MODULES: Final = frozenset({"collision", "obstacle", "geofence", "battery"})

OF_A_CHARGE: Final = "of a charge"
"""The unit of margins that are parts of a charge."""

_SHORT_S: Final = 60.0
_ANSWERS: Final = 0.8


class Row(NamedTuple):
    """One line of the summary.

    Attributes:
        name: name of the figure; indented if it is part of the one above.
        thesis: its value in the thesis; empty if there is none that can be compared.
    """

    name: str
    value: str
    thesis: str = ""
    style: str = ""


def differences(result: RunResult) -> list[str]:
    """Return how a run differs from the thesis's; empty if totals can be compared."""
    found = []
    if not math.isclose(result.duration_s, THESIS_DURATION_S, rel_tol=0.01):
        found.append(f"{_time(result.duration_s)} instead of {_time(THESIS_DURATION_S)}")
    if result.robots != THESIS_ROBOTS:
        found.append(f"{_many(result.robots, 'robot')} instead of {THESIS_ROBOTS}")
    if result.ac != "mission":
        found.append(f"AC {result.ac} instead of the mission")
    elif result.targets_from != THESIS_TARGETS:
        found.append(f"{_aim(result)} instead of {THESIS_TARGETS}")
    if set(result.modules) != THESIS_MODULES:
        found.append(f"{', '.join(result.modules) or 'no'} module{'s' if len(result.modules) != 1 else ''} "
                     "instead of all four")  # fmt: skip
    return found


def per_robot_hour(disengagements: int, robots: int, duration_s: float) -> float:
    """Return a number of disengagements as a rate; NaN for a run of no length."""
    hours = robots * duration_s / 3600.0
    return disengagements / hours if hours > 0.0 else math.nan


def rows(result: RunResult) -> list[list[Row]]:
    """Return the summary, a list for each block of it."""
    if not result.robots:
        # A process with the task planner only: other processes have the robots' figures.
        return [list(_targets(result)), list(_lateness(result))]
    blocks = (_violations, _failed, _control, _targets, _machinery)
    return [list(block(result)) for block in blocks]


def _violations(result: RunResult) -> Iterator[Row]:
    if result.violations is None:
        yield Row("violations", "unknown: there is no ground truth", "0")
        return
    total = sum(result.violations.values())
    ended_s = result.truth_ended_s
    known = str(total) if ended_s is None else f"{total} up to {_time(ended_s)}, unknown since then"
    yield Row("violations", known, "0", "bold red" if total else "bold green" if ended_s is None else "bold yellow")
    for rule, count in result.violations.items():
        margin = (result.min_margin or {}).get(rule)
        seen = "" if margin is None or margin == math.inf else f", least margin {_precise(rule, margin, count > 0)}"
        yield Row(f"  {rule}", f"{count}{seen}", style="red" if count else "")
    if result.contacts:
        yield Row("contacts", str(result.contacts), style="red")


def _failed(result: RunResult) -> Iterator[Row]:
    """Yield failures that broke no rule, and what was accepted without proof."""
    for robot, each in result.uncontrolled.items():
        text = f"for {_time(each.lasted_s)}, first after {_time(each.first_s)}: {each.cause}"
        yield Row(f"not under control, robot {robot}", text, style="bold red")
    failed = [(number, robot, each) for robot, found in result.assumptions.items() for number, each in found.items()]
    yield Row("assumptions failed", str(len(failed)) if failed else "none was seen to", style="red" if failed else "")
    for number, robot, breach in sorted(failed, key=lambda each: (int(each[0][1:]), each[1])):
        worst = [(each.excess, each.unit, each.time_s, each.cause) for each in breach.worst]
        yield Row(f"  {number}, robot {robot}", breach_text(breach.times, breach.first_s, breach.cause, worst))
    for robot, stall in result.permanent_stalls.items():
        why = ": ".join(filter(None, (stall.module, stall.cause)))
        yield Row(f"stalled, robot {robot}", f"{_time(stall.lasted_s)} up to the end, by {why}", style="red")
    if result.never_moved:
        yield Row("never moved", f"robot {', '.join(map(str, result.never_moved))}", style="red")
    for text in result.accepted_unproved:
        yield Row("not proved", f"accepted: {text}", style="yellow")


def _control(result: RunResult) -> Iterator[Row]:
    yield Row("AC in control", _percent(result.ac_share), _percent(THESIS_AC_SHARE), "bold")
    yield Row("  without charging", _percent(result.ac_share_without_charging))
    comparable = not differences(result)
    total = result.disengagements_total
    yield Row("disengagements", str(total), str(THESIS_DISENGAGEMENTS) if comparable else "", "bold")
    rate = per_robot_hour(total, result.robots, result.duration_s)
    thesis_rate = per_robot_hour(THESIS_DISENGAGEMENTS, THESIS_ROBOTS, THESIS_DURATION_S)
    yield Row("  per robot-hour", "-" if math.isnan(rate) else f"{rate:.0f}", f"{thesis_rate:.0f}")
    for module, count in result.disengagements.items():
        also = result.joined.get(module, 0)
        yield Row(f"  {module}", f"{count}, joined {also} more" if also else str(count))
    if total:
        yield Row("  needless", str(result.needless))


def _targets(result: RunResult) -> Iterator[Row]:
    # Controllers are given no targets.
    given = result.ac == "mission"
    if given:
        targets = result.targets
        yield Row("targets reached", str(targets.reached), style="bold")
        yield Row("  given up", f"{targets.unsafe} unsafe, {targets.blocked} blocked, {targets.timed_out} timed out")
    if given and result.robots:
        yield Row("longest stall", f"{result.longest_stall_s:.1f} s")
    if result.robots:
        yield Row("longest without AC", f"{result.longest_without_ac_s:.1f} s, not charging")
    if given:
        yield Row("no progress for", f"{result.no_progress_s:.1f} s")
    if result.paths_replaced:
        yield Row("plans replaced", f"{result.paths_replaced} by certified ways")
    if result.no_certified_motion:
        yield Row("no certified motion", _many(result.no_certified_motion, "tick"))


def _machinery(result: RunResult) -> Iterator[Row]:
    yield Row("speed", f"{result.real_time_factor:.1f} x real time ({_time(result.duration_s)} "
                       f"in {_time(result.wall_s)})")  # fmt: skip
    tick = result.dm_tick_us
    yield Row("decisions, a tick", f"p50 {tick.p50:.1f} us, p99 {tick.p99:.1f} us, max {tick.max:.0f} us")
    yield from _lateness(result)
    if result.answered is not None and result.answered < _ANSWERS:
        who = "the mission" if result.ac == "mission" else result.ac
        yield Row("ticks answered", f"{100.0 * result.answered:.1f} % by {who}: it is slow", style="yellow")
    if result.missed_ticks:
        yield Row("missed ticks", str(result.missed_ticks), style="yellow")
    if (sandbox := result.sandbox) is not None:
        off = "" if sandbox else "no: isolation.sandbox is off"
        yield Row("mission boxed in", off, style="yellow")
        for what, by in sandbox.items():
            yield Row(f"  {what}", by, style="yellow" if by.startswith("open") else "")


def _lateness(result: RunResult) -> Iterator[Row]:
    if (late := result.tick_late_ms) is not None:
        how = ", scheduled in real time" if result.real_time else ""
        yield Row("ticks late by", f"p50 {late.p50:.1f} ms, p99 {late.p99:.1f} ms, max {late.max:.1f} ms{how}")
    if (age := result.peer_age_ms) is not None:
        yield Row("peers' samples, age", f"p50 {age.p50:.0f} ms, p99 {age.p99:.0f} ms, max {age.max:.0f} ms")


def _errand(result: RunResult) -> str:
    """Return the task of the ACs in words: planner and targets for the mission, else the ACs' name."""
    if result.ac != "mission":
        return f"AC {PurePath(result.ac).name}"
    return f"planner {result.planner}, {_aim(result)}"


def _aim(result: RunResult) -> str:
    return f"{result.targets_from} targets" if result.targets_from else f"mission {PurePath(result.does).name}"


def headline(result: RunResult) -> str:
    """Return a headline for a run: robots, duration, backend, task, modules, seed."""
    engine = f", engine {result.engine}" if result.engine not in (None, result.backend) else ""
    modules = f"modules: {', '.join(result.modules)}" if result.modules else "no safety modules"
    process = f"process '{result.process}': " if result.process else ""
    return (
        f"{process}{_many(result.robots, 'robot')} for {_time(result.duration_s)} on {result.backend}{engine}; "
        f"{_errand(result)}; {modules}; seed {result.seed}"
    )


def outcome(result: RunResult) -> tuple[str, str]:
    """Return how the run ended, and a style for it."""
    if result.status == "failed":
        return f"failed after {_time(result.duration_s)}: {result.failure}", "bold red"
    if result.status == "interrupted":
        return f"interrupted after {_time(result.duration_s)}; the robots are stopped", "bold yellow"
    if result.violated:
        return f"{result.status}, with violations", "bold red"
    if result.abandoned:
        return f"{result.status}, but no robot has its AC any more", "bold red"
    return result.status, "bold green"


def remarks(result: RunResult, *, compared: bool = False) -> list[str]:
    """Return remarks that a reader needs to judge the figures, `compared` with the thesis's or not."""
    found = []
    if result.process:
        found.append("These are the figures of this process alone; that of the task planner counts all targets.")
    elif compared and (differing := differences(result)):
        found.append(f"Not the thesis's run ({', '.join(differing)}): compare shares and rates, not totals.")
    found += [f"Robot {robot} lost its AC: {why}" for robot, why in result.failed_robots.items()]
    if not result.deterministic and result.nondeterminism:
        found.append(f"Another run of this seed may differ: {result.nondeterminism}")
    return found


def print_summary(console: Console, result: RunResult, *, compared: bool = False) -> None:
    """Print the summary, `compared` with the thesis's figures or not."""
    ended, style = outcome(result)
    name = PurePath(result.mission).name or "mission"
    console.print(Text.assemble((f"{name}: ", "bold"), (ended, style)), soft_wrap=True)
    console.print(Text(headline(result)), soft_wrap=True)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", no_wrap=True)
    table.add_column("this run")
    if compared:
        table.add_column("thesis", justify="right")
    for block in rows(result):
        for row in block:
            table.add_row(row.name, Text(row.value, row.style), *([row.thesis] if compared else []))
        table.add_section()
    console.print(table)
    for remark in remarks(result, compared=compared):
        console.print(remark, soft_wrap=True)
    if result.trace_sha256:
        console.print(Text(f"trace {result.trace_sha256}", "dim"), soft_wrap=True)


def caption(result: RunResult, safer_charge: float) -> Caption:
    """Return the texts for the picture of a run; `safer_charge` is the battery module's phi_safer, from 0 to 1."""
    from soter.report.caption import Caption

    name = PurePath(result.mission).stem or "mission"
    if result.violations is None:
        violations = "violations unknown"
    else:
        total = sum(result.violations.values())
        violations = _many(total, "violation") if total else "no violation"
    on = f"the {result.engine} engine" if result.engine else result.backend
    ended = "" if result.status == "completed" else f" ({result.status})"
    return Caption(
        title=f"{name}: {_many(result.robots, 'robot')}, {_time(result.duration_s)} on {on}{ended}",
        figures=(
            f"AC in control {_percent(result.ac_share)}",
            _many(result.disengagements_total, "disengagement"),
            violations,
        ),
        alarming=result.violated,
        details=f"{_errand(result)}, seed {result.seed}",
        disengagements=dict(result.disengagements),
        rules=tuple(_rules(result)),
        safer_charge=safer_charge if "battery" in result.modules else None,
    )  # fmt: skip


def _rules(result: RunResult) -> Iterator[Rule]:
    from soter.report.caption import Rule

    for rule, count in (result.violations or {}).items():
        margin = (result.min_margin or {}).get(rule, math.inf)
        # A column of a picture has no room for "not a number".
        least = "NaN" if math.isnan(margin) else "-" if margin == math.inf else _precise(rule, margin, count > 0)
        yield Rule(rule, f"{count} ×", least, broken=count > 0)


def _time(seconds: float) -> str:
    if seconds < 2 * _SHORT_S:
        return f"{seconds:.3g} s"
    if seconds < 3600.0:
        return f"{seconds / 60.0:.3g} min"
    return f"{seconds / 3600.0:.3g} h"


def breach_text(times: int, first_s: float, cause: str, worst: Sequence[tuple[float, str, float, str]]) -> str:
    """Return in words how often an assumption failed, with the first and the worst looks."""
    first = "once, at" if times == 1 else f"{times} times, first at"
    text = f"{first} {first_s:.2f} s: {cause}"
    for excess, unit, time_s, why in worst:
        amount = f"{100.0 * excess:.3g} % {unit}" if unit == OF_A_CHARGE else f"{excess:.3g} {unit}".strip()
        text += f", by {amount}" if why == cause else f"; worst, by {amount}, at {time_s:.2f} s: {why}"
    return text


def _many(count: int, thing: str) -> str:
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def _percent(part: float) -> str:
    return f"{100.0 * part:.1f} %"


def _precise(rule: str, margin: float, broken: bool) -> str:
    if math.isnan(margin):
        return "not a number"
    if rule == "battery":
        return _percent(margin)
    # Adding 0.0 turns -0.0 into 0.0.
    rounded = round(margin, 3) + 0.0
    return "< 0 m" if broken and rounded == 0.0 else f"{rounded:.3f} m"

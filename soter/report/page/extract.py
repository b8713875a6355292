"""What of a recording goes into its page: what is exact, and what is thinned out so that a long run stays small.

Exact are all events: who drove from when to when, disengagements and their causes, targets, goals, violations, gaps.
Poses are thinned out to every so many ticks. Margins and charges are gathered into buckets, of which the least and
the largest value are kept, so that no minimum is lost. What was done is said in the page.
"""

from __future__ import annotations

from array import array
from pathlib import PurePath
from typing import Any, Final

import numpy as np

from soter.record.messages import AC, Goal, RobotAbout, Switch, Target, Violation
from soter.record.reader import Content, Recording, Series
from soter.record.summary import Summary, summarise
from soter.report.colours import ac_colour, driver_colour
from soter.report.page.pack import Columns, buckets, fewest_steps, starts_of_runs
from soter.workspace import Box, Workspace

VERSION: Final = 1
MOST_POSES: Final = 320_000
"""Of all robots together."""

MOST_BUCKETS: Final = 36_000
"""Of one robot."""

_TIME_S: Final = 1e-3
_PLACE_M: Final = 1e-3
_HEADING_RAD: Final = 2e-3
_MARGIN: Final = 1e-4
_CHARGE: Final = 1e-4


def extract(recording: Recording) -> tuple[str, str]:
    """Return a page's title and its data as text.

    Raises:
        BadRecording: the recording is damaged, or lacks what a page shows.
        ConfigError: its workspace is not allowed.
    """
    content = recording.content()
    summary = summarise(recording, content)
    ways: dict[int, list[tuple[float, list[tuple[float, float]]]]] = {robot: [] for robot in content.series}
    for time_s, robot_id, places in recording.ways():
        ways[robot_id].append((time_s, places))

    columns = Columns()
    every_ticks = fewest_steps(content.ticks * max(len(content.series), 1), MOST_POSES)
    bucket_ticks = fewest_steps(content.ticks, MOST_BUCKETS)
    robots = [
        {
            **_robot(about, index, content, every_ticks, bucket_ticks, columns),
            "ways": _ways(ways[about.robot_id], columns),
        }
        for index, about in enumerate(recording.about.robots)
    ]
    title = _title(summary)
    document = {
        "version": VERSION,
        "title": title,
        "firstS": content.first_s,
        "lastS": content.last_s,
        "drivers": [
            {"name": name, "colour": ac_colour(0) if name == AC else driver_colour(name)} for name in content.drivers
        ],
        "workspace": _workspace(recording.workspace()),
        "robots": robots,
        "switches": [_switch(each, content.drivers) for each in content.switches],
        "truth": _truth(recording, content, summary),
        "drops": [[_s(each.time_s), each.first_tick, each.ticks] for each in content.drops],
        "faults": [[each.kind, each.robot_id, each.declared, each.affected] for each in _last_faults(content)],
        "thinned": {
            "tickS": recording.about.base_tick_s,
            "poseTicks": every_ticks,
            "bucketTicks": bucket_ticks,
        },
        "summary": _figures(recording, summary),
    }
    return title, columns.packed(document)


# --- one robot ---------------------------------------------------------------------------------------------


def _robot(
    about: RobotAbout, index: int, content: Content, every_ticks: int, bucket_ticks: int, columns: Columns
) -> dict[str, Any]:
    series = content.series[about.robot_id]
    runs = starts_of_runs(series.driver)
    charge_low, charge_high = buckets(series.battery, bucket_ticks)
    return {
        "id": about.robot_id,
        "colour": ac_colour(index),
        "radiusM": about.capabilities.get("body_radius_m", 0.1),
        "poses": {
            "timeS": columns.add(_thin(series.time_s, every_ticks), _TIME_S),
            "xM": columns.add(_thin(series.x_m, every_ticks), _PLACE_M),
            "yM": columns.add(_thin(series.y_m, every_ticks), _PLACE_M),
            # Unwrapped, so that a turn through the back makes no jump.
            "headingRad": columns.add(np.unwrap(_thin(series.heading_rad, every_ticks)), _HEADING_RAD),
        },
        "stretches": [[series.time_s[start], series.driver[start]] for start in runs],
        "bucketS": columns.add(np.asarray(series.time_s)[::bucket_ticks], _TIME_S),
        "charge": {"low": columns.add(charge_low, _CHARGE), "high": columns.add(charge_high, _CHARGE)},
        "modules": _modules(about, series, bucket_ticks, columns),
        "targets": _targets([each for each in content.targets if each.robot_id == about.robot_id]),
        "goals": _goals([each for each in content.goals if each.robot_id == about.robot_id], columns),
    }


def _modules(about: RobotAbout, series: Series, bucket_ticks: int, columns: Columns) -> list[dict[str, Any]]:
    found = []
    for module in about.modules:
        low, high = buckets(series.margins.get(module.name, array("d")), bucket_ticks)
        # The largest bound of a bucket: what is drawn must not look better than it was.
        _, reach = buckets(series.reaches.get(module.name, array("d")), bucket_ticks)
        found.append({
            "name": module.name,
            "unit": module.unit,
            "edge": module.edge_margin,
            "horizonReach": module.horizon_reach,
            "low": columns.add(low, _MARGIN),
            "high": columns.add(high, _MARGIN),
            "reach": columns.add(reach, _MARGIN),
        })  # fmt: skip
    return found


def _targets(targets: list[Target]) -> list[list[Any]]:
    """Return number, begin, end, x, y and outcome of every target; what has not ended has no end."""
    rows: dict[int, list[Any]] = {}
    for each in targets:
        if not each.outcome:
            rows[each.target_id] = [each.target_id, _s(each.time_s), None, each.x_m, each.y_m, ""]
        elif each.target_id in rows:
            rows[each.target_id][2], rows[each.target_id][5] = _s(each.time_s), each.outcome
    return list(rows.values())


def _goals(goals: list[Goal], columns: Columns) -> dict[str, int]:
    """Return columns: begin and end in fleet time, x, y, and 1 where the AC sent the goal."""
    rows: list[list[float]] = []
    for each in goals:
        if rows and np.isinf(rows[-1][1]):
            # The next goal supersedes one that nobody ended.
            rows[-1][1] = each.time_s
        if each.status == "active":
            rows.append([each.time_s, np.inf, each.x_m, each.y_m, float(each.by == AC)])
    table = np.asarray(rows, dtype=np.float64).reshape(-1, 5)
    return {
        "beginS": columns.add(table[:, 0], _TIME_S),
        "endS": columns.add(table[:, 1], _TIME_S),
        "xM": columns.add(table[:, 2], _PLACE_M),
        "yM": columns.add(table[:, 3], _PLACE_M),
        "byAc": columns.add(table[:, 4], 1.0),
    }


def _ways(ways: list[tuple[float, list[tuple[float, float]]]], columns: Columns) -> dict[str, int]:
    """Return columns: when each way was meant, at which place it begins, and the places of all of them."""
    places = [place for _, each in ways for place in each]
    begins = np.cumsum([0, *(len(each) for _, each in ways)])
    return {
        "timeS": columns.add([time_s for time_s, _ in ways], _TIME_S),
        "begin": columns.add(begins, 1.0),
        "xM": columns.add([x for x, _ in places], _PLACE_M),
        "yM": columns.add([y for _, y in places], _PLACE_M),
    }


def _thin(values: array[float], every: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return every so-manieth value, and the last one."""
    numbers = np.asarray(values, dtype=np.float64)
    thinned = numbers[::every]
    return thinned if not len(numbers) or (len(numbers) - 1) % every == 0 else np.append(thinned, numbers[-1])


# --- the run -----------------------------------------------------------------------------------------------


def _title(summary: Summary) -> str:
    name = PurePath(summary.mission).stem or "mission"
    robots = len(summary.robots)
    minutes = summary.duration_s / 60.0
    lasted = f"{summary.duration_s:.3g} s" if minutes < 2.0 else f"{minutes:.3g} min"
    return f"{name}: {robots} robot{'s' if robots != 1 else ''}, {lasted} on {summary.backend}"


def _workspace(workspace: Workspace) -> dict[str, Any]:
    return {
        "widthM": workspace.width_m,
        "depthM": workspace.depth_m,
        "boxes": [_box(box) for box in workspace.boxes],
        "chargers": [_box(place.charger) for place in workspace.robots],
    }


def _box(box: Box) -> list[float]:
    return [box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m]


def _switch(switch: Switch, drivers: tuple[str, ...]) -> list[Any]:
    return [
        switch.time_s, switch.robot_id, drivers.index(switch.before), drivers.index(switch.after), switch.module,
        switch.cause, list(switch.joined),
    ]  # fmt: skip


def _truth(recording: Recording, content: Content, summary: Summary) -> dict[str, Any]:
    """Return what ground truth saw, and how far it is known."""
    result = recording.result
    counted = None if result is None else result.get("violations")
    margins = (result or {}).get("min_margin") or {}
    return {
        # Three cases: judged, never judged, or ended before the judgement was written down.
        "known": "not summed up" if result is None else "no" if counted is None else "yes",
        "endedS": (result or {}).get("truth_ended_s"),
        "counts": summary.violations,
        "margins": {rule: _finite(margin) for rule, margin in margins.items()},
        "violations": [_violation(each) for each in content.violations],
    }


def _violation(violation: Violation) -> list[Any]:
    end_s = violation.end_s if isinstance(violation.end_s, float) else None
    return [violation.rule, list(violation.robots), violation.start_s, end_s]


def _last_faults(content: Content) -> list[Any]:
    return list({(each.kind, each.robot_id): each for each in content.faults}.values())


def _figures(recording: Recording, summary: Summary) -> dict[str, Any]:
    result = recording.result or {}
    return {
        "file": PurePath(summary.file).name,
        "sizeBytes": summary.size_bytes,
        "truncated": summary.truncated,
        "droppedTicks": summary.dropped_ticks,
        "ticks": summary.ticks,
        "mission": summary.mission,
        "backend": summary.backend,
        "engine": result.get("engine") or "",
        "ac": str(recording.about.mission.get("ac", "mission")),
        "planner": str(recording.about.mission.get("planner", "")),
        "seed": summary.seed,
        "startedUtc": summary.started_utc,
        "virtualTime": summary.virtual_time,
        "status": summary.status,
        "failure": str(result.get("failure") or ""),
        "acShare": summary.ac_share,
        "disengagements": summary.disengagements,
        "targets": summary.targets,
        "batteryReleasedFrom": _battery_released_from(recording),
        "traceSha256": str(result.get("trace_sha256") or ""),
        "versions": summary.versions,
    }


def _battery_released_from(recording: Recording) -> float | None:
    """Return the charge from which on a robot that went to charge is given back; None without that module."""
    if "battery" not in recording.about.modules:
        return None
    rta = recording.about.mission.get("rta")
    battery = rta.get("battery") if isinstance(rta, dict) else None
    return _finite(battery.get("phi_safer")) if isinstance(battery, dict) else None


def _finite(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else None


def _s(time_s: float) -> float:
    return round(time_s, 4)

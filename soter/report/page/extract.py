"""Makes the data of a recording's page: the story of the run, ground truth's findings, the figures, the versions."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import PurePath
from typing import Any, Final

import numpy as np

from soter.geometry.workspace import Box, Workspace
from soter.record.attachments import Result
from soter.record.content import Content
from soter.record.messages import AC, ViolationEvent
from soter.record.reader import Recording
from soter.record.summary import Summary, summarise
from soter.report.colours import ac_colour, driver_colour
from soter.report.page.pack import Columns, fewest_steps
from soter.report.page.rules import body_radius_m
from soter.report.page.story import Buckets, Numbers, RobotStory, Rows, Story

VERSION: Final = 1
MOST_POSES: Final = 320_000
"""Most poses of all robots together."""

MOST_BUCKETS: Final = 36_000
"""Most buckets of one robot."""

_TIME_S: Final = 1e-3
_PLACE_M: Final = 1e-3
_HEADING_RAD: Final = 2e-3
_MARGIN: Final = 1e-4
_CHARGE: Final = 1e-4


def extract(recording: Recording) -> tuple[str, str]:
    """Return a page's title and its data as text.

    Raises:
        BadRecording: the recording is damaged, or lacks data that a page shows.
        ConfigError: its workspace is not allowed.
    """
    content = recording.content()
    story = Story(
        recording.about,
        recording.workspace(),
        fewest_steps(content.ticks * max(len(content.series), 1), MOST_POSES),
        fewest_steps(content.ticks, MOST_BUCKETS),
    )
    story.add(content)
    document = Document(story, recording, content)
    return document.title, document.packed()


class Document:
    """The data of a page, as text.

    Args:
        recording: the run's recording; for a run that goes on, the part up to now.
        content: its events and counts.
        news: whether to include only data that were not sent yet, which then count as sent.

    Raises:
        BadRecording: the recording lacks data that a page shows.
        ConfigError: its workspace is not allowed.
    """

    def __init__(
        self, story: Story, recording: Recording, content: Content, *, news: bool = False, goes_on: bool = False
    ) -> None:
        self._columns: Final = Columns()
        self._news: Final = news
        summary = summarise(recording, content)
        self.title: Final = _title(summary)
        faults = {(each.kind, each.robot_id): each for each in content.faults}
        self._document: Final = {
            "version": VERSION,
            "title": self.title,
            "goesOn": goes_on,
            "firstS": content.first_s,
            "lastS": content.last_s,
            "drivers": [
                {"name": name, "colour": ac_colour(0) if name == AC else driver_colour(name)} for name in story.drivers
            ],
            "workspace": _workspace(recording.workspace(), recording.safer_inset_m),
            "robots": [self._robot(robot, index) for index, robot in enumerate(story.robots)],
            "switches": self._rows(story.switches),
            "truth": _truth(recording, content, summary, goes_on=goes_on),
            "drops": self._rows(story.drops),
            "breaches": self._rows(story.breaches),
            "stalls": self._rows(story.stalls),
            "faults": [[each.kind, each.robot_id, each.declared, each.affected] for each in faults.values()],
            "thinned": {
                "tickS": recording.about.base_tick_s,
                "poseTicks": story.pose_ticks,
                "bucketTicks": story.bucket_ticks,
            },
            "summary": _figures(recording, summary),
        }

    def packed(self) -> str:
        """Return the document and all its columns as text for a page."""
        return self._columns.packed(self._document)

    def _robot(self, robot: RobotStory, index: int) -> dict[str, Any]:
        about, column = robot.about, self._column
        begin_s, end_s, goal_x_m, goal_y_m, by_ac = robot.goals
        return {
            "id": about.robot_id,
            "colour": ac_colour(index),
            "radiusM": body_radius_m(about),
            "poses": {
                "timeS": column(robot.time_s, _TIME_S),
                "xM": column(robot.x_m, _PLACE_M),
                "yM": column(robot.y_m, _PLACE_M),
                # Unwrapped, so that differences are small.
                "headingRad": column(robot.heading_rad, _HEADING_RAD, np.unwrap),
            },
            "stretches": self._rows(robot.stretches),
            "startedS": robot.started_s,
            "bucketS": column(robot.bucket_s, _TIME_S),
            "charge": self._pair(robot.charge, _CHARGE),
            "modules": [
                {
                    "name": module.name,
                    "colour": driver_colour(module.name),
                    "unit": module.unit,
                    "edge": module.edge_margin,
                    "horizonReach": module.horizon_reach,
                    **self._pair(margins, _MARGIN),
                    # The largest bound of a bucket, so that the chart does not look better than the run was.
                    "reach": column(reaches.high, _MARGIN),
                }
                for module, margins, reaches in zip(robot.modules, robot.margins, robot.reaches, strict=True)
            ],
            "targets": self._rows(robot.targets),
            "goals": {
                "beginS": column(begin_s, _TIME_S),
                "endS": column(end_s, _TIME_S),
                "xM": column(goal_x_m, _PLACE_M),
                "yM": column(goal_y_m, _PLACE_M),
                "byAc": column(by_ac, 1.0),
            },
            "ways": {
                "timeS": column(robot.way_s, _TIME_S),
                "begin": column(robot.way_begin, 1.0),
                "xM": column(robot.way_x_m, _PLACE_M),
                "yM": column(robot.way_y_m, _PLACE_M),
            },
        }

    def _pair(self, gathered: Buckets, quantum: float) -> dict[str, int]:
        return {"low": self._column(gathered.low, quantum), "high": self._column(gathered.high, quantum)}

    def _column(self, numbers: Numbers, quantum: float, change: Callable[[Any], Any] = np.asarray) -> int:
        since, values = numbers.news() if self._news else numbers.whole()
        return self._columns.add(change(values), quantum, since)

    def _rows(self, rows: Rows) -> dict[str, Any]:
        since, values = rows.news() if self._news else rows.whole()
        return {"since": since, "rows": values}


def _title(summary: Summary) -> str:
    name = PurePath(summary.mission).stem or "mission"
    robots = len(summary.robots)
    lasted_s = summary.duration_s
    lasted = f"{lasted_s:.3g} s" if lasted_s < 120.0 else f"{lasted_s / 60.0:.3g} min"
    return f"{name}: {robots} robot{'s' if robots != 1 else ''}, {lasted} on {summary.backend}"


def _workspace(workspace: Workspace, inset_m: float | None) -> dict[str, Any]:
    fence, kept_out = workspace.outlines()
    return {
        "bounds": workspace.bounds,
        "fence": fence,
        "inner": [] if inset_m is None else workspace.inset(inset_m),
        "keptOut": kept_out,
        "chargers": [_box(place.charger) for place in workspace.robots],
    }


def _box(box: Box) -> list[float]:
    return [box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m]


def _truth(recording: Recording, content: Content, summary: Summary, *, goes_on: bool) -> dict[str, Any]:
    """Return the findings of ground truth, and how far they are known."""
    result = recording.result
    counted = None if result is None else result.violations
    margins = (None if result is None else result.min_margin) or {}
    # Whether ground truth judged a finished run; for others, whether the judgement may still come.
    known = "no" if counted is None else "yes"
    return {
        "known": "goes on" if goes_on else "not summed up" if result is None else known,
        "endedS": None if result is None else result.truth_ended_s,
        "counts": summary.violations,
        "margins": {rule: _finite(margin) for rule, margin in margins.items()},
        "violations": [_violation(each) for each in content.violations],
    }


def _violation(violation: ViolationEvent) -> list[Any]:
    end_s = violation.end_s if isinstance(violation.end_s, float) else None
    return [violation.rule, list(violation.robots), violation.start_s, end_s]


def _figures(recording: Recording, summary: Summary) -> dict[str, Any]:
    result = recording.result or Result("")
    return {
        "file": PurePath(summary.file).name,
        "sizeBytes": summary.size_bytes,
        "truncated": summary.truncated,
        "droppedTicks": summary.dropped_ticks,
        "ticks": summary.ticks,
        "mission": summary.mission,
        "backend": summary.backend,
        "engine": result.engine or "",
        "ac": PurePath(str(recording.about.mission.get("ac", "mission"))).name,
        "planner": str(recording.about.mission.get("planner", "")),
        "seed": summary.seed,
        "elsewhere": [peer.robot_id for peer in recording.about.peers],
        "startedUtc": summary.started_utc,
        "virtualTime": summary.virtual_time,
        "status": summary.status,
        "failure": result.failure,
        "neverMoved": summary.never_moved,
        "acceptedUnproved": summary.accepted_unproved,
        "acShare": summary.ac_share,
        "disengagements": summary.disengagements,
        "targets": summary.targets,
        "batteryReleasedFrom": _battery_released_from(recording),
        "traceSha256": result.trace_sha256 or "",
        "versions": summary.versions,
    }


def _battery_released_from(recording: Recording) -> float | None:
    """Return the charge from which a robot that went to charge is given back; None without the battery's module."""
    if "battery" not in recording.about.modules:
        return None
    rta = recording.about.mission.get("rta")
    battery = rta.get("battery") if isinstance(rta, dict) else None
    return _finite(battery.get("phi_safer")) if isinstance(battery, dict) else None


def _finite(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and abs(value) <= sys.float_info.max else None

"""Draws the picture of a counterexample: the rule's edge, the take-over, and the place of the breach."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from soter.check.trial import Obligation
from soter.record.messages import AC
from soter.record.tracks import RunTracks, Track
from soter.report.caption import Caption, Margins, Remark
from soter.report.picture import draw_png
from soter.rta import Region, Situation, SwitchRecord
from soter.sdk import Link, RobotState

if TYPE_CHECKING:
    from soter.check.trial import Attempt, BrokenObligation
    from soter.geometry.workspace import Workspace
    from soter.rta import RTAModule

_CELLS: Final = 160


def draw_trial(workspace: Workspace, trial: Attempt, module: RTAModule, title: str) -> bytes:
    """Return a trial of a module as the content of a PNG file, with the drivers and the place of the breach."""
    drivers = (AC, *dict.fromkeys(row.driver for row in trial.rows if row.driver != AC))
    run = RunTracks(workspace, drivers, *tracks_of(trial, drivers), begins=False)
    breach = trial.breaches[0] if trial.breaches else None
    if breach is None:
        return draw_png(run, Caption(title=title, alarming=True))
    broken = Remark(breach.x_m, breach.y_m, f"{breach.obligation.value} broken at {breach.time_s:.2f} s", broken=True)
    caption = Caption(
        title=title, figures=(f"{breach.obligation.value}: {breach.text}",), alarming=True,
        remarks=(*_takeover(run, breach), broken), rule=_edge(workspace, trial, module, breach),
    )  # fmt: skip
    return draw_png(run, caption)


def tracks_of(trial: Attempt, drivers: Sequence[str]) -> tuple[dict[int, Track], list[SwitchRecord]]:
    """Return the ways of a trial's robots by id, and the switches; a way's drivers are indices into `drivers`."""
    tracks: dict[int, Track] = {}
    switches = []
    for row in trial.rows:
        track = tracks.setdefault(row.robot_id, Track())
        if track.driver and drivers[track.driver[-1]] != row.driver:
            before, after = (None if name == AC else name for name in (drivers[track.driver[-1]], row.driver))
            # A row has the driver of the robot since the row before.
            switches.append(SwitchRecord(track.time_s[-1], row.robot_id, before, after, after or before or "", "", ()))
        track.add(row.time_s, row.x_m, row.y_m, row.battery, drivers.index(row.driver))
    return tracks, switches


def _takeover(run: RunTracks, breach: BrokenObligation) -> list[Remark]:
    """Return a remark at the robot's last take-over before the breach; none if there was no take-over."""
    from soter.report.strokes import place_at

    taken = [
        each
        for each in run.switches
        if each.robot_id == breach.robot_id and each.before is None and each.time_s <= breach.time_s
    ]
    if not taken or (place := place_at(run.tracks[breach.robot_id], taken[-1].time_s)) is None:
        return []
    return [Remark(*place, f"{taken[-1].module} took over at {taken[-1].time_s:.2f} s", broken=False)]


def _edge(workspace: Workspace, trial: Attempt, module: RTAModule, breach: BrokenObligation) -> Margins | None:
    """Return the broken rule's margins all over the workspace; None without an edge there, or if the rule fails.

    They are for the moment of the breach: with the robot's speed and its peers' places at that time.
    """
    which, region = (
        ("phi_safer", module.phi_safer) if breach.obligation is Obligation.P2B else ("phi_safe", module.phi_safe)
    )
    states = _states(trial, breach.time_s)
    if not isinstance(region, Region) or breach.robot_id not in states:
        return None
    own = states.pop(breach.robot_id)
    low_x, low_y, high_x, high_y = workspace.bounds
    rim_m = 0.05 * max(high_x - low_x, high_y - low_y)
    xs = [low_x - rim_m + (high_x - low_x + 2.0 * rim_m) * column / _CELLS for column in range(_CELLS + 1)]
    ys = [low_y - rim_m + (high_y - low_y + 2.0 * rim_m) * row / _CELLS for row in range(_CELLS + 1)]
    peers = list(states.values())
    try:
        margins = [[_margin(region, own._replace(x_m=x_m, y_m=y_m), peers, breach.time_s) for x_m in xs] for y_m in ys]
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - a user's code, whose failure is a finding of its own
        return None
    flat = [each for row in margins for each in row]
    if not min(flat) < 0.0 < max(flat):
        return None
    return Margins(xs, ys, margins, f"where {which} of {module.name} does not hold for robot {breach.robot_id}")


def _margin(region: Region, own: RobotState, peers: Sequence[RobotState], now_s: float) -> float:
    situation = Situation(own.robot_id, own, now_s)
    situation.peers = peers
    return region.margin(situation)


def _states(trial: Attempt, time_s: float) -> dict[int, RobotState]:
    """Return the states of the robots at a moment, with the speeds from their samples before."""
    found: dict[int, RobotState] = {}
    for row in trial.rows:
        if row.time_s > time_s:
            break
        before = found.get(row.robot_id)
        vx_m_s = vy_m_s = 0.0
        if before is not None and row.time_s > before.stamp_s:
            passed_s = row.time_s - before.stamp_s
            vx_m_s, vy_m_s = (row.x_m - before.x_m) / passed_s, (row.y_m - before.y_m) / passed_s
        found[row.robot_id] = RobotState(
            row.robot_id, row.time_s, row.time_s, row.x_m, row.y_m, 0.0, row.heading_rad, vx_m_s, vy_m_s, 0.0,
            row.battery, None, None, Link.UP,
        )  # fmt: skip
    return found

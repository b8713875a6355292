"""Derives a mission's robots, their promises and the backend's options, and checks them."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from functools import partial

from soter.config import MissionFile, validate_options
from soter.errors import BackendError, ConfigError, SoterError, account_of, floor_m, nearest
from soter.faults import FaultTable, read_faults, under_faults
from soter.faults.telemetry import BatteryOptions
from soter.geometry.workspace import Workspace
from soter.problems import UNKNOWN_KEY, dotted
from soter.registry import BUILT_IN, backend_names, load_backend
from soter.sdk import Backend, BackendConfig, Capabilities, RobotSpec, RuleLimits
from soter.stack.planners.names import check_name

logger = logging.getLogger(__name__)

_ROUNDING = 1e-9


def robot_specs(mission: MissionFile, workspace: Workspace, asked: Mapping[int, Capabilities]) -> list[RobotSpec]:
    """Return the robots of the workspace, each with the mission's battery and with its requested promise."""
    battery = mission.battery
    return [
        RobotSpec(
            place.id, place.x_m, place.y_m, place.heading_rad, mission.initial_charge(place.id),
            battery.drive_s, battery.idle_s, battery.charge_s, f"robot{place.id}", asked[place.id],
        )
        for place in workspace.robots
    ]  # fmt: skip


def read_options(backend: type[Backend], mission: MissionFile, workspace: Workspace) -> BackendConfig:
    """Return the mission's options of a backend, checked by its model, with the limits for the ground truth.

    Ground truth also judges by the tables of modules that are off: runs with and without a module are judged alike.

    Raises:
        ConfigError: an option that the backend does not have or allow, or that another built-in one with a table does
            not have; the message names its key. Or a table of options for an unknown backend or planner.
    """
    _refuse_misspelt_tables(mission)
    for name in mission.backends:
        if name in BUILT_IN and name != mission.backend:
            try:
                _options_of(load_backend(name, to_open=False), name, mission, workspace)
            except ConfigError as failure:
                # A misspelt key is wrong everywhere; other values may be right where that backend is used, such as
                # files of that host.
                if UNKNOWN_KEY in str(failure):
                    raise
    return _options_of(backend, mission.backend, mission, workspace)


def _options_of(backend: type[Backend], name: str, mission: MissionFile, workspace: Workspace) -> BackendConfig:
    """Return the options that a mission's table gives to a backend, checked by its model."""
    return validate_options(
        backend.config_model,
        mission.backends.get(name, {}),
        mission.source,
        dotted("backends", name),
        {
            "workspace": workspace,
            "seed": mission.seed,
            "limits": RuleLimits(mission.rta.collision.phi_safe_m, mission.rta.obstacle.phi_safe_m),
        },
        mission.overridden,
    )


def asked(
    backend: type[Backend], config: BackendConfig, mission: MissionFile, workspace: Workspace
) -> dict[int, Capabilities]:
    """Return the requested promise of each robot of a mission, by id: `[robots.N]` goes before the backend's options.

    Raises:
        ConfigError: a value in `[robots.N]` is not allowed on this backend; names key, value and what is allowed.
        BackendError: the backend cannot give a promise for its options.
    """
    said = mission.robots.promises

    def of(robot_id: int) -> Capabilities:
        # Limits of the backend's options hold for each robot, too.
        both = {**config.promise.given, **said[robot_id].given}
        promise = validate_options(
            type(config.promise), both, mission.source, f"robots.{robot_id}", overridden=mission.overridden
        )
        return _promised(backend, config.model_copy(update={"promise": promise}), mission)

    common = _promised(backend, config, mission)
    return {place.id: of(place.id) if place.id in said else common for place in workspace.robots}


def _promised(backend: type[Backend], config: BackendConfig, mission: MissionFile) -> Capabilities:
    """Return the promise of a backend's robots; the backend may be a third party's."""
    try:
        return backend.promises(config)
    except SoterError:
        raise
    except Exception as failure:
        cause = account_of(failure, str)
        raise BackendError(f"{mission.backend}: its robots cannot promise that: {cause}") from failure


def promises(
    backend: type[Backend], config: BackendConfig, mission: MissionFile, workspace: Workspace
) -> dict[int, Capabilities]:
    """Return the promise of each robot of a mission, by id, under its declared faults.

    Raises:
        ConfigError: a tick is longer than a lease, or makes samples older than promised; a fault is not allowed, or
            makes every battery seem too low for the AC; or the robots' bodies do not fit into the workspace.
    """
    declared = asked(backend, config, mission, workspace)
    for each in set(declared.values()):
        _check_tick(mission, each)
    ids = [*declared]
    faults = read_faults(mission, ids)
    for fault in faults:
        if fault.kind.needs_vehicle and not hasattr(backend.robot_class, "impair"):
            raise mission.refusal(
                f"fault.{fault.index}.kind",
                f"it is '{fault.options.kind}', which needs a vehicle that can be impaired, and a "
                f"{backend.robot_class.__name__} cannot; allowed on robots simulated in this process, as by kinematic",
            )
    _check_charge(mission, ids, faults)
    promised = {robot_id: under_faults(mission, faults, robot_id, each) for robot_id, each in declared.items()}
    check_bodies(mission, workspace, {robot_id: each.body_radius_m for robot_id, each in promised.items()})
    return promised


def promises_of(mission: MissionFile, workspace: Workspace) -> dict[int, Capabilities]:
    """Return `promises` for the mission's backend, without opening it; raises BackendError if there is none."""
    backend = load_backend(mission.backend, to_open=False)
    return promises(backend, read_options(backend, mission, workspace), mission, workspace)


def _check_tick(mission: MissionFile, declared: Capabilities) -> None:
    """Check that leases are renewed in time and, in virtual time, that samples are not older than promised.

    In virtual time robots move in whole control periods.
    """
    tick_s, period_s = mission.base_tick_s, declared.setpoint_period_s
    if tick_s > declared.lease_s + _ROUNDING:
        raise mission.refusal(
            "base_tick_s",
            f"it is {tick_s:.12g}, but a lease lasts {declared.lease_s:.12g} s, so that robots would stop between two "
            f"ticks; allowed: at most {declared.lease_s:.12g}, or robots that promise a longer lease_s",
        )
    ticks = max(1, round(tick_s / period_s))
    whole = math.isclose(ticks * period_s, tick_s, rel_tol=1e-9)
    if declared.in_process and not whole and declared.sample_age_s < period_s:
        raise mission.refusal(
            "base_tick_s",
            f"it is {tick_s:.12g}, but these robots move in periods of {period_s:.12g} s, so that samples would be up "
            f"to {period_s:g} s old and not {declared.sample_age_s:g} s as promised; allowed: a multiple of "
            f"{period_s:.12g}; the nearest is {ticks * period_s:.12g}",
        )


def _check_charge(mission: MissionFile, ids: Sequence[int], faults: Sequence[FaultTable]) -> None:
    """Check that a full battery is enough for the AC, for robots with declared faults that report too low a charge."""
    battery = mission.rta.battery
    if "battery" not in mission.rta.order:
        return
    needed_s = battery.dwell_s + battery.delta_s
    for robot_id in ids:
        always = [
            table.options.offset
            for table in faults
            if table.hits(robot_id) and isinstance(table.options, BatteryOptions) and table.options.declared
            if table.options.pause_s < needed_s
        ]
        most = 1.0 + sum(always)
        if always and battery.phi_safer > most + _ROUNDING:
            raise mission.refusal(
                "rta.battery.phi_safer",
                f"it is {battery.phi_safer:g}, but under its declared faults robot {robot_id} reports {most:g} with a "
                f"full battery, and would never be given back; allowed: at most {most:g}",
            )


def check_bodies(mission: MissionFile, workspace: Workspace, radius_m: Mapping[int, float]) -> None:
    """Check that bodies fit: beside each other at the separation, at their starts, and on their stations.

    Args:
        mission: its `rta` table.
        workspace: the workspace.
        radius_m: the promised body radius of each robot, by id.

    Raises:
        ConfigError: bodies do not fit; names the key or the robot, the numbers, and what would do.
    """
    order, phi_safe_m = mission.rta.order, mission.rta.collision.phi_safe_m
    one_m, other_m = sorted((0.0, *radius_m.values()))[-2:]
    if "collision" in order and len(radius_m) > 1 and phi_safe_m < one_m + other_m - _ROUNDING:
        raise mission.refusal(
            "rta.collision.phi_safe_m",
            f"it is {phi_safe_m:g}, but two bodies of the radii {one_m:g} m and {other_m:g} m overlap at less "
            f"than {one_m + other_m:g} m; allowed: at least {one_m + other_m:g}, below phi_safer_m",
        )
    least_m = mission.rta.obstacle.phi_safer_m if "obstacle" in order else 0.0
    for place in workspace.robots:
        spots = {"start": (place.x_m, place.y_m), "station": place.charger.centre}
        for name, (x_m, y_m) in spots.items():
            clearance_m = workspace.clearance_m(x_m, y_m, radius_m[place.id])
            if clearance_m < least_m - _ROUNDING:
                raise mission.refusal(
                    "workspace",
                    f"the body of robot {place.id}, of a radius of {radius_m[place.id]:g} m, is {floor_m(clearance_m)} "
                    f"m from a box at its {name}, ({x_m:g}, {y_m:g}); allowed: at least {least_m:g} m",
                )
    for index, one in enumerate(workspace.robots):
        for other in workspace.robots[:index]:
            needed_m = max(phi_safe_m if "collision" in order else 0.0, radius_m[one.id] + radius_m[other.id])
            apart = {
                "starts": math.hypot(one.x_m - other.x_m, one.y_m - other.y_m),
                "stations": math.dist(one.charger.centre, other.charger.centre),
            }
            for name, apart_m in apart.items():
                if apart_m < needed_m - _ROUNDING:
                    raise mission.refusal(
                        "workspace",
                        f"the {name} of robots {other.id} and {one.id} are {floor_m(apart_m)} m apart; allowed: at "
                        f"least {needed_m:g} m, for bodies of the radii {radius_m[other.id]:g} m and "
                        f"{radius_m[one.id]:g} m",
                    )


def _refuse_misspelt_tables(mission: MissionFile) -> None:
    """Refuse a misspelt planner, and tables of options for misspelt backends and planners, which would be ignored.

    A user would rely on the options in them. A backend that is not installed here may have a table, with a warning.
    """
    others = [name for name in mission.backends if name not in BUILT_IN and ":" not in name]
    # Whoever asks what is installed looks through all of it.
    known = backend_names() if others else []
    for name in others:
        if name in known:
            continue
        key, close = f"backends.{name}", nearest(name, known)
        problem = f"no backend of that name is installed{close}; there are {', '.join(known)}"
        if close:
            raise mission.refusal(key, problem)
        logger.warning("%s is not used: %s", key, problem)
    for key, name in (("planner", mission.planner), *((dotted("planners", name), name) for name in mission.planners)):
        check_name(name, partial(mission.refusal, key))

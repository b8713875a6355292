"""Draws robots' promises: slow and fast, small and large robots, alike or not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pkgutil import resolve_name
from random import Random
from typing import Any, Final

from soter.adapters.pybullet import PERIOD_S, SimulatedPromise
from soter.campaign.random.configuration import Tables
from soter.faults import BUILT_IN as FAULT_KINDS
from soter.faults import Fault, FaultOptions
from soter.faults.fault import Context, widened
from soter.geometry.workspace import Workspace
from soter.onboard.drive import OVERSHOOT_M, tube_m
from soter.registry import load_backend
from soter.sdk import Capabilities

MOST_TIMES: Final = 8.0
"""Largest factor by which rooms are enlarged for large or fast robots."""

_UNLIKE: Final = range(1, 5)


@dataclass(frozen=True)
class DrawnFleet:
    """The promises of a mission's robots.

    Attributes:
        tables: the keys of the mission file for the backend and the promises of all robots.
        unlike: by id, promises of single robots, which override those.
    """

    tables: Tables
    unlike: Mapping[int, Tables]

    @property
    def options(self) -> Tables:
        """The backend's options."""
        found: Tables = self.tables.get("backends", {}).get(self.tables["backend"], {})
        return found

    def room(self, rng: Random) -> float:
        """Return the factor by which rooms are larger than for TurtleBots."""
        times = 1.0
        for each in (self.options.get("promise", {}), *self.unlike.values()):
            top_m_s, brake_m_s2 = each.get("v_max_m_s", 0.22), each.get("brake_m_s2", 1.0)
            times = max(times, top_m_s / 0.22, top_m_s**2 / brake_m_s2 / 0.3, each.get("body_radius_m", 0.0) / 0.2)
        times = min(times, MOST_TIMES)
        return rng.uniform(max(1.0, 0.6 * times), times)

    def promises(self, faults: Sequence[dict[str, Any]], robots: int, tick_s: float) -> list[Capabilities]:
        """Return the promises of `robots` robots under their faults."""
        backend = load_backend(self.tables["backend"], to_open=False)
        nowhere, options = Workspace(1.0, 1.0, (), ()), self.options
        found = []
        for robot_id in range(1, robots + 1):
            both = {**options.get("promise", {}), **self.unlike.get(robot_id, {})}
            declared = backend.promises(backend.config_model(workspace=nowhere, **{**options, "promise": both}))
            made = []
            for table in faults:
                if table.get("robot", "all") in ("all", robot_id):
                    kind: type[Fault[Any]] = resolve_name(FAULT_KINDS[table["kind"]])
                    fault_options: FaultOptions = kind.options_model.model_validate(table)
                    made.append(kind(fault_options, Context(robot_id, tick_s, Random(0))))
            found.append(widened(declared, made))
        return found


def draw_fleet(rng: Random, nasty: bool, engine: str) -> DrawnFleet:
    """Return robots' promises: for a third the backend's defaults, for others common or single ones, or both.

    `nasty` draws at the edges of what is valid; for `engine`, see `soter.campaign.random.drawing.draw`.
    """
    chance = rng.random()
    if engine != "kinematic" or chance >= 0.7:
        return DrawnFleet({"backend": "pybullet", "backends": {"pybullet": {"engine": engine}}}, {})
    tables: Tables = {"backend": "kinematic"}
    common: Tables = {}
    if chance < 0.4:
        common = _robot(rng, nasty, {})
        tables["backends"] = {"kinematic": {"promise": common}}
    unlike = sorted(rng.sample(_UNLIKE, rng.randint(1, len(_UNLIKE)))) if chance > 0.25 else []
    return DrawnFleet(tables, {robot_id: _robot(rng, nasty, common) for robot_id in unlike})


def _robot(rng: Random, nasty: bool, common: Tables) -> Tables:
    """Return some promises of a robot; the others are those in `common`, or the backend's defaults."""
    scale = 1.0 if nasty else 0.5
    slow = rng.random() < 0.5
    figures = {
        "v_max_m_s": 0.22 - rng.uniform(0.0, 0.18 if nasty else 0.14) if slow else _spread(rng, 0.22, 1.5),
        "brake_m_s2": 1.0 - rng.uniform(0.0, 0.85) * scale if slow else _spread(rng, 0.4, 3.0),
        "accel_m_s2": _spread(rng, 0.1, 3.0),
        "yaw_rate_max_rad_s": _spread(rng, 0.1, 5.0),
        "latency_s": 0.05 + rng.uniform(0.0, 0.2) * scale,
        "sample_age_s": rng.uniform(0.0, 0.2) * scale,
        "jitter_s": rng.uniform(0.0, 0.1) * scale,
        "lease_s": (0.05 if nasty and rng.random() < 0.3 else 0.1) + rng.uniform(0.0, 0.5) * scale,
        "position_noise_m": rng.uniform(0.0, 0.1) * scale,
        "speed_noise_m_s": rng.uniform(0.0, 0.05) * scale,
        "heading_noise_rad": rng.uniform(0.0, 0.2) * scale,
        "overshoot_m": OVERSHOOT_M + rng.uniform(0.0, 0.05) * scale,
        "body_radius_m": 0.105 + rng.uniform(0.0, 0.4) * scale,
    }
    kept = rng.sample([*figures], rng.randint(1, 6))
    found = {name: round(value, 3) for name, value in figures.items() if name in kept}
    promised = SimulatedPromise.model_validate({**common, **found, "tube_m": None})
    overshoot_m = 0.0 if nasty and rng.random() < 0.2 else promised.overshoot_m or 0.0
    if rng.random() < 0.4 or overshoot_m or "tube_m" in common:
        least_m = max(tube_m(promised.limits, PERIOD_S), overshoot_m)
        found["tube_m"] = round(least_m + 0.001 + rng.uniform(0.0, 0.08) * scale, 3)
    return found


def _spread(rng: Random, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))

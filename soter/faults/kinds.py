"""Makes faults from the tables of a mission file: built-in kinds by name, or others as `module:Class`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Any, Final

from soter.config import MissionFile, validate_options
from soter.errors import ConfigError
from soter.faults.fault import (
    ROUNDING_S,
    Call,
    Context,
    Fault,
    FaultOptions,
    Impairment,
    Passage,
    SentCommand,
    agreed,
    widened,
)
from soter.faults.telemetry import ClockStepOptions
from soter.loading import described, known_target, load_class
from soter.sdk import Capabilities, Link, RobotState
from soter.sdk.robot import FUTURE_S

BUILT_IN: Final[Mapping[str, str]] = {
    "delay": "soter.faults.link:Delay",
    "loss": "soter.faults.link:Loss",
    "duplicate": "soter.faults.link:Duplicate",
    "freeze": "soter.faults.telemetry:Freeze",
    "bias": "soter.faults.telemetry:Bias",
    "clock_step": "soter.faults.telemetry:ClockStep",
    "battery": "soter.faults.telemetry:Battery",
    "wheel_slip": "soter.faults.vehicle:WheelSlip",
    "weak_brakes": "soter.faults.vehicle:WeakBrakes",
    "kill": "soter.faults.vehicle:Kill",
}
"""The built-in kinds, and their classes."""


@dataclass(frozen=True, slots=True)
class FaultTable:
    """One checked `[[fault]]` table, with its index from 0."""

    index: int
    kind: type[Fault[Any]]
    options: FaultOptions

    def made_for(self, robot_id: int, seed: int, tick_s: float) -> Fault[Any]:
        """Return the fault for one robot, with random numbers from the mission's seed."""
        random = Random(f"fault {self.index}, robot {robot_id}, seed {seed}")
        return self.kind(self.options, Context(robot_id, tick_s, random))

    def hits(self, robot_id: int) -> bool:
        """Return whether the fault affects a robot."""
        return self.options.robot in ("all", robot_id)


def read_faults(mission: MissionFile, robot_ids: Sequence[int]) -> tuple[FaultTable, ...]:
    """Return the `[[fault]]` tables of a mission, each checked with the model of its kind, and tried.

    Raises:
        ConfigError: an unknown kind, option or robot, a value that is not allowed, or a kind of the user's own that
            fails.
    """
    tables = tuple(_read(mission, index, raw, robot_ids) for index, raw in enumerate(mission.fault))
    for robot_id in robot_ids:
        ahead_s = 0.0
        for table in tables:
            options = table.options
            if isinstance(options, ClockStepOptions) and options.declared and table.hits(robot_id):
                ahead_s += max(0.0, options.step_s)
                if ahead_s >= FUTURE_S - ROUNDING_S:
                    raise mission.refusal(
                        f"fault.{table.index}.step_s",
                        f"it is {options.step_s:g}, which puts the clock of robot {robot_id} {ahead_s:g} s ahead; "
                        f"allowed: below {FUTURE_S:g} s in all, since stamps farther ahead are not believed; or "
                        "declared = false",
                    )
        _try(mission, [table for table in tables if table.hits(robot_id)], robot_id)
    return tables


def _try(mission: MissionFile, tables: Sequence[FaultTable], robot_id: int) -> None:
    """Call a robot's faults as the beginning of a run does.

    Refuses a fault that hides a robot from the beginning: a run cannot begin without a sample of each robot.

    Raises:
        ConfigError: a fault does that, or fails; names the fault.
    """
    ready = RobotState(robot_id, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, None, None, Link.UP)
    sample: RobotState | None = ready
    for table in tables:
        with _blaming(mission, table):
            fault = table.made_for(robot_id, mission.seed, mission.base_tick_s)
            # As in a run, where faults see a sample before they begin.
            fault.sample(0.0, False, ready)
            if not table.options.active(0.0):
                continue
            for passage in fault.command(0.0, SentCommand(Call.RENEW)):
                agreed(passage, Passage)
            agreed(fault.impairment() or Impairment(), Impairment)
            sample = fault.sample(0.0, True, sample)
            if sample is not None:
                agreed(sample, RobotState)
        if sample is None or sample.stamp_s > FUTURE_S:
            raise mission.refusal(
                f"fault.{table.index}.start_s",
                f"it is {table.options.start_s:g}, but a run begins with a sample of each robot, and none of robot "
                f"{robot_id} would be seen; allowed: above 0, such as {mission.base_tick_s:g}",
            )


def under_faults(
    mission: MissionFile, tables: Sequence[FaultTable], robot_id: int, capabilities: Capabilities
) -> Capabilities:
    """Return the promise of a robot of a mission under those faults that hit it.

    Raises:
        ConfigError: a fault fails, or the promise becomes one that nobody may make; names the fault.
    """
    hits = [table for table in tables if table.hits(robot_id)]
    faults = [table.made_for(robot_id, mission.seed, mission.base_tick_s) for table in hits]
    return widened(capabilities, faults, lambda index: _blaming(mission, hits[index]))


@contextmanager
def _blaming(mission: MissionFile, table: FaultTable) -> Iterator[None]:
    """Turn whatever fails in a fault, which may be of a user's class, into a ConfigError that names its table."""
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # foreign code
        raise mission.refusal(
            f"fault.{table.index}.kind", f"it is '{table.options.kind}', which failed: {described(failure, None)}"
        ) from failure


def _read(mission: MissionFile, index: int, raw: Mapping[str, Any], robot_ids: Sequence[int]) -> FaultTable:
    key = f"fault.{index}"
    name = raw.get("kind")
    if not isinstance(name, str):
        said = "it is missing, and has no default" if name is None else f"it is {name!r}, allowed: a text in quotes"
        raise mission.refusal(f"{key}.kind", f"{said}; known kinds are {', '.join(BUILT_IN)}")
    kind = _kind(name, partial(mission.refusal, f"{key}.kind"))
    options = validate_options(kind.options_model, raw, mission.source, key, overridden=mission.overridden)
    if options.robot != "all" and options.robot not in robot_ids:
        listed = ", ".join(map(str, robot_ids))
        message = f'it is {options.robot}, but there is no such robot; allowed: "all", {listed}'
        raise mission.refusal(f"{key}.robot", message)
    return FaultTable(index, kind, options)


def _kind(name: str, refused: Callable[[str], ConfigError]) -> type[Fault[Any]]:
    """Import the class of a kind; `refused` makes the error."""
    found = load_class(name, known_target(name, BUILT_IN, "kind", refused), Fault, refused)
    model = getattr(found, "options_model", None)
    if not (isinstance(model, type) and issubclass(model, FaultOptions)):
        raise refused(f"kind '{name}': it needs an 'options_model' that is a subclass of soter.faults.FaultOptions")
    return found

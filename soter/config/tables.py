"""The tables of a mission file: safety modules, batteries, isolation, distribution."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from soter.config.table import Name, RobotId, Table, wrong
from soter.errors import nearest
from soter.problems import not_allowed

MODULES: Final = ("collision", "obstacle", "geofence", "battery")
"""The safety modules, in order of priority: the first of them in SC drives."""

SURVEILLANCE: Final = "surveillance"
"""The mission of a file that names none."""

_TAKEN: Final = (*MODULES, "path", "supervisor")
"""Names that have another meaning in results."""

MotionModel = Literal["speed", "speed-acceleration", "unicycle"]
# A lower bound well above the smallest float: sums of tiny steps do not grow, and quotients overflow.
Lasting = Annotated[float, Field(ge=0.1, le=1e9, allow_inf_nan=False)]
Metres = Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False)]
Period = Annotated[float, Field(ge=0.001, le=60.0, allow_inf_nan=False)]
Charge = Annotated[float, Field(ge=0.001, le=1.0, allow_inf_nan=False)]
RawTables = dict[str, dict[str, Any]]
Targets = Literal["grid", "uniform", "hostile"]
DEFAULT_TARGETS: Final[Targets] = "grid"


class MissionTable(Table):
    """The mission, `mission = "NAME"` or `[mission]`: all keys except `use` are the mission's own options.

    Attributes:
        use: a mission by name, or a class as `file.py:Class`, `file.py` or `module:Class`; `load_mission` makes a file
            relative to the mission file.
    """

    model_config = ConfigDict(extra="allow", frozen=True, strict=True)

    use: Name = SURVEILLANCE

    @model_validator(mode="before")
    @classmethod
    def _named(cls, given: object) -> object:
        return {"use": given} if isinstance(given, str) else given

    @property
    def options(self) -> dict[str, Any]:
        """The options, raw; checked by the model of the mission's class."""
        return dict(self.model_extra or {})


class ModuleTable(Table):
    """The settings of every safety module.

    Attributes:
        delta_s: how often its decision module looks; a multiple of the base tick.
        dwell_s: how long the robot must be inside phi_safer before it is given back.
    """

    delta_s: Period
    dwell_s: Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)] = 0.3


class DistanceTable(ModuleTable):
    """A module that keeps a distance.

    Attributes:
        phi_safe_m: the distance that must never be undercut.
        phi_safer_m: the distance from which the robot may be given back.
    """

    phi_safe_m: Metres
    phi_safer_m: Metres

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.phi_safer_m <= self.phi_safe_m:
            raise wrong(("phi_safer_m",), self.phi_safer_m, f"above phi_safe_m, which is {self.phi_safe_m:.12g}")
        return self


class MotionTable(Table):
    """A module whose margin falls as robots move.

    Attributes:
        model: what its reach bound uses: top speed and brake only; also the present speed; or also the heading, of a
            robot that moves along its heading and turns. The last two need robots that promise more.
    """

    model: MotionModel = "speed"


class CollisionTable(MotionTable, DistanceTable):
    """Distance between the centres of two robots."""

    delta_s: Period = 0.05
    phi_safe_m: Metres = 0.3
    phi_safer_m: Metres = 0.7


class ObstacleTable(MotionTable, DistanceTable):
    """Clearance between the body and the nearest box."""

    delta_s: Period = 0.05
    phi_safe_m: Metres = 0.0
    phi_safer_m: Metres = 0.1


class GeofenceTable(MotionTable, ModuleTable):
    """The fence: phi_safe is the workspace itself.

    Attributes:
        phi_safer_inset_m: how far inside the fence phi_safer lies, on every side.
    """

    delta_s: Period = 0.05
    phi_safer_inset_m: Annotated[float, Field(ge=0.001, le=1000.0, allow_inf_nan=False)] = 0.1


class BatteryModuleTable(ModuleTable):
    """Enough charge for the return path.

    Attributes:
        phi_safer: charge from 0 to 1 from which a robot may be given back.
        reserve_factor: the reserve, as a multiple of the cost of the longest return path.
    """

    delta_s: Period = 1.0
    phi_safer: Charge = 0.85
    reserve_factor: Annotated[float, Field(ge=1.0, le=100.0, allow_inf_nan=False)] = 4.0


class PathTable(DistanceTable):
    """The protected planner: body clearance that a planned path keeps from boxes.

    Attributes:
        enabled: whether paths are judged at all; without it the planner is used as it is.
    """

    enabled: bool = False
    delta_s: Period = 0.05
    phi_safe_m: Metres = 0.06
    phi_safer_m: Metres = 0.1


def _as_target(text: str) -> str:
    if re.fullmatch(r"[a-z][a-z0-9_-]*", text):
        return text  # registered by a distribution
    where, _, function = text.rpartition(":")
    is_module = all(part.isidentifier() for part in where.split("."))
    if not (function.isidentifier() and (is_module or where.endswith(".py"))):
        raise not_allowed(
            "a function as 'package.module:function' or 'file.py:function', or a registered module's name"
        )
    return text


class UserModuleTable(Table):
    """A safety module of the user's own, `[rta.module.NAME]`; see docs/writing-a-module.md.

    Attributes:
        declare: the function that declares it, as `file.py:function` or `package.module:function`, or the name that a
            distribution has registered it by.
        before: the module over which it has priority: a shipped one, or a user's module listed above it. If not given,
            it comes first.
        enabled: False leaves this module out.
        options: raw options, checked by the model that the function takes.
    """

    declare: Annotated[str, AfterValidator(_as_target)]
    before: Name = MODULES[0]
    enabled: bool = True
    options: dict[str, Any] = Field(default_factory=dict)


def _in_fixed_order(modules: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(modules)) != len(modules):
        twice = next(name for name in modules if modules.count(name) > 1)
        raise not_allowed(f"each module once, '{twice}' is there twice")
    return tuple(name for name in MODULES if name in modules)


class RtaTable(Table):
    """The safety modules.

    Attributes:
        enabled: False removes the decision modules and nothing else.
        modules: the shipped modules that are on; their priority is always that of `MODULES`.
        collision: distance to other robots.
        obstacle: clearance to boxes.
        geofence: the fence.
        battery: the charge for the return path.
        path: the protected planner, which does not compete for the actuator.
        module: the user's own modules, by name.
    """

    enabled: bool = True
    modules: Annotated[
        tuple[Literal["collision", "obstacle", "geofence", "battery"], ...],
        Field(strict=False),
        AfterValidator(_in_fixed_order),
    ] = MODULES
    collision: CollisionTable = CollisionTable()
    obstacle: ObstacleTable = ObstacleTable()
    geofence: GeofenceTable = GeofenceTable()
    battery: BatteryModuleTable = BatteryModuleTable()
    path: PathTable = PathTable()
    module: dict[str, UserModuleTable] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _named_and_ranked(self) -> Self:
        known = list(MODULES)
        for name, table in self.module.items():
            if name in _TAKEN or not re.fullmatch(r"[a-z][a-z0-9_-]{0,39}", name):
                allowed = f"small letters, digits, - and _, beginning with a letter, and none of {', '.join(_TAKEN)}"
                raise wrong(("module", name), name, f"a name of {allowed}")
            if table.before not in known:
                allowed = f"{', '.join(known)}{nearest(table.before, known)}"
                raise wrong(("module", name, "before"), table.before, allowed)
            known.append(name)
        return self

    @property
    def order(self) -> tuple[str, ...]:
        """The names of all modules that are on, in order of priority."""
        names = list(MODULES)
        for name, table in self.module.items():
            names.insert(names.index(table.before), name)
        on = {*self.modules, *(name for name, table in self.module.items() if table.enabled)}
        return tuple(name for name in names if self.enabled and name in on)


def _by_robot(value: object) -> object:
    """Accept a list, for robot ids from 1, or a table, whose keys are texts in TOML."""
    if isinstance(value, list | tuple):
        return dict(enumerate(value, start=1))
    if isinstance(value, Mapping):
        return {
            int(key) if isinstance(key, str) and re.fullmatch(r"\d{1,3}", key, re.ASCII) else key: charge
            for key, charge in value.items()
        }
    return value


class BatteryTable(Table):
    """The batteries of simulated robots.

    Attributes:
        drive_s: time from full to empty when driving.
        idle_s: time from full to empty when standing still, at least `drive_s`.
        charge_s: time from empty to full at the charger.
        initial: initial charge from 0 to 1, by robot id; robots that are not listed have one drawn from the seed.
    """

    drive_s: Lasting = 1800.0
    idle_s: Lasting = 7200.0
    charge_s: Lasting = 60.0
    initial: Annotated[dict[RobotId, Charge] | None, BeforeValidator(_by_robot)] = None

    @model_validator(mode="after")
    def _waits_cheaply(self) -> Self:
        if self.idle_s < self.drive_s:
            allowed = f"at least drive_s, which is {self.drive_s:.12g}: standing still costs no more than driving"
            raise wrong(("idle_s",), self.idle_s, allowed)
        return self


class IsolationTable(Table):
    """How the supervisor is isolated from the mission, which on a wall clock has a process of its own.

    Attributes:
        memory_mib: address space that the mission may use beyond what it starts with, in MiB; its planners start within
            it.
        silent_s: host time for which the mission may be silent before it counts as hung.
        real_time: whether the supervisor is scheduled in real time, before other work of the host; `auto` is wherever
            the kernel allows it.
        sandbox: whether the kernel denies the mission, and planners on any clock, network, files and other processes;
            `auto` is as far as the kernel can, `require` refuses to run if it cannot, see `soter.isolation.sandbox`.
        read: files and folders that the mission may read besides its own folder, Python and importable modules;
            relative to the folder in which SOTER is started.
    """

    memory_mib: Annotated[int, Field(ge=64, le=1 << 20)] = 2048
    silent_s: Annotated[float, Field(ge=0.5, le=60.0, allow_inf_nan=False)] = 2.0
    real_time: Literal["auto", "always", "never"] = "auto"
    sandbox: Literal["auto", "require", "off"] = "auto"
    read: Annotated[tuple[str, ...], Field(strict=False)] = ()


class ReseedTable(Table):
    """One `[[reseed]]`: from a time on, the random numbers of faults come from another seed.

    Attributes:
        at_s: fleet time from which on, inclusive.
        seed: the new seed.
    """

    at_s: Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]


class ProcessTable(Table):
    """One process of a distributed mission, `[distribution.processes.NAME]`.

    Attributes:
        robots: the ids of the robots that it commands.
        planner: whether the task planner is in it.
        bus: this process's own options of the bus, in place of the common ones, such as a certificate.
    """

    robots: Annotated[tuple[RobotId, ...], Field(strict=False)] = ()
    planner: bool = False
    bus: dict[str, Any] = Field(default_factory=dict)


class DistributionTable(Table):
    """The processes of a distributed mission; without any, everything is in one process.

    Attributes:
        processes: the processes by name.
        via: the bus that joins them, by name, or its class as `module:Class`.
        bus: raw options of the bus; checked by the bus's own model.
        prefix: prefix of the keys on the bus; missions that share a network need different ones.
        wait_s: host time for which a process waits at its start for all others.
    """

    processes: dict[str, ProcessTable] = Field(default_factory=dict)
    via: Name = "zenoh"
    bus: dict[str, Any] = Field(default_factory=dict)
    prefix: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*$")] = "soter"
    wait_s: Annotated[float, Field(ge=0.1, le=86400.0, allow_inf_nan=False)] = 60.0

    @model_validator(mode="after")
    def _everything_once(self) -> Self:
        homes: dict[int, str] = {}
        planners: list[str] = []
        for name, table in self.processes.items():
            if not re.fullmatch(r"[a-z][a-z0-9_-]{0,39}", name):
                allowed = "a name of small letters, digits, - and _, beginning with a letter"
                raise wrong(("processes", name), name, allowed)
            for robot_id in table.robots:
                if robot_id in homes:
                    allowed = f"each robot once; robot {robot_id} is in '{homes[robot_id]}' already"
                    raise wrong(("processes", name, "robots"), list(table.robots), allowed)
                homes[robot_id] = name
            if table.planner and planners:
                allowed = f"one task planner; there is one in '{planners[0]}' already"
                raise wrong(("processes", name, "planner"), True, allowed)
            planners += [name] * table.planner
            if not (table.planner or table.robots):
                raise wrong(("processes", name), {}, "robots = [...], planner = true, or both")
        return self

"""The campaign file: which missions are run, with which settings, what is asked of them, and when it is enough."""

from __future__ import annotations

import copy
import itertools
import json
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from random import Random
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from soter.campaign.conditions import Requirement, StoppingRule
from soter.campaign.job import Job
from soter.campaign.sources import code_hash, sources_hash
from soter.config import MissionFile
from soter.config.tables import Name, Table, wrong
from soter.errors import ConfigError
from soter.problems import config_error, parse_toml, pydantic_problems, read_limited, shown_value
from soter.registry import load_backend
from soter.sdk import RULES

SEED: Final = "seed"
DRAWN: Final = "random"
"""The mission of a part whose configurations are drawn; see `soter.campaign.random`."""

Settings = dict[str, Any]
Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]
Number = Annotated[float, Field(allow_inf_nan=False)]


class SeedsTable(Table):
    """Seeds that follow each other.

    Attributes:
        first: the first of them.
        count: how many.
    """

    first: Seed = 1
    count: Count


class RangeTable(Table):
    """Where a number is drawn from, or searched for.

    Attributes:
        low: the least.
        high: the greatest.
        log: evenly over its logarithm.
        whole: whole numbers only.
    """

    low: Number
    high: Number
    log: bool = False
    whole: bool = False

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.high <= self.low:
            raise wrong(("high",), self.high, f"above low, which is {self.low:g}")
        if self.log and self.low <= 0.0:
            raise wrong(("low",), self.low, "above 0 where log is true")
        return self

    def at(self, part: float) -> float:
        """Return the number at a part of the range, from 0 to 1."""
        if self.log:
            value = math.exp(math.log(self.low) + part * (math.log(self.high) - math.log(self.low)))
        else:
            value = self.low + part * (self.high - self.low)
        # A number that can be written is one that a command line can repeat.
        return round(value) if self.whole else float(f"{min(max(value, self.low), self.high):.9g}")


def _ranges(tables: object, above: str = "") -> object:
    """Return nested tables of ranges as ranges by dotted key; for pydantic."""
    if not isinstance(tables, dict):
        return tables
    found: dict[str, object] = {}
    for key, value in tables.items():
        name = f"{above}.{_quoted(key)}" if above else key
        is_inner = isinstance(value, dict) and value and not {"low", "high"} & set(value)
        inner = _ranges(value, name) if is_inner else {name: value}
        found |= inner if isinstance(inner, dict) else {}
    return found


class SampleTable(Table):
    """Settings that are drawn at random.

    Attributes:
        count: how many times.
        seed: what is drawn from; a larger count leaves what was drawn before as it was.
        draw: by key a range, or a list of values.
    """

    count: Count
    seed: Seed = 0
    draw: Annotated[dict[str, RangeTable | list[Any]], BeforeValidator(_ranges)]

    def rows(self) -> Iterator[tuple[str, Settings]]:
        """Yield a name and settings for each draw."""
        for number in range(self.count):
            row: Settings = {}
            for key, values in self.draw.items():
                rng = Random(f"sample {self.seed}, {number}, {key}")
                row[key] = values.at(rng.random()) if isinstance(values, RangeTable) else rng.choice(values)
            yield str(number + 1), row


class SearchTable(Table):
    """A search for the run with the least figure.

    Attributes:
        minimise: a figure of the result, such as "min_margin.collision".
        runs: how many runs it may take.
        over: the ranges that it searches, by key.
        seed: what the optimiser draws from.
        below: it ends at the first run in which the figure is below this; None for never.
        by: CMA-ES; or at random, to be compared with.
    """

    minimise: Name
    runs: Count
    over: Annotated[dict[str, RangeTable], BeforeValidator(_ranges), Field(min_length=1)]
    seed: Seed = 0
    below: Number | None = None
    by: Literal["cma", "random"] = "cma"


class SplitTable(Table):
    """Importance splitting: how often the least margin of a rule falls below a value; see `soter.campaign.splitting`.

    Attributes:
        rule: a safety module, or a rule of the user's own.
        below: the value, in the margin's unit.
        repetitions: how often all of it is done, independently; the seeds are shared out among them.
        at_most: what is required of the share of the runs, by the upper end of its interval; None for nothing.
    """

    rule: Name
    below: Number = 0.0
    repetitions: Annotated[int, Field(ge=5, le=1000)] = 10
    at_most: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None


Axis = list[Any] | dict[str, dict[str, Any]]
"""Values of the key that the axis is named after; or by name the settings of several keys."""


class PartTable(Table):
    """Runs that belong together.

    Attributes:
        name: names it.
        mission: the mission file, relative to the campaign's; or "random", which draws configurations from the seeds.
        set: values by key, in all its runs; nested tables are read as dotted keys.
        grid: axes, of which every combination is run.
        sample: settings that are drawn; each draw is run with every combination of the grid.
        seeds: each combination is run with each of them.
        require: what is asked of its runs; see `soter.campaign.conditions`.
        until: it is ended when this is shown; see there.
        repeats: the part whose runs these must repeat bit by bit.
        search: looks for the worst over declared ranges.
        split: estimates how often what is rare happens.
        may_refuse: runs may be refused as ill-formed or not proved.
        accept_unproved: what cannot be proved is run, as by `soter run --accept-unproved`.
        limit_s: host time that one run may take.
        note: what its table says of it.
    """

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
    mission: Name
    set: dict[str, Any] = Field(default_factory=dict)
    grid: dict[str, Axis] = Field(default_factory=dict)
    sample: SampleTable | None = None
    seeds: SeedsTable | Annotated[list[Seed], Field(min_length=1)] = Field(default=[1])
    require: Annotated[tuple[Requirement, ...], Field(strict=False)] = ()
    until: StoppingRule | None = None
    repeats: str = ""
    search: SearchTable | None = None
    split: SplitTable | None = None
    may_refuse: bool = False
    accept_unproved: bool = False
    limit_s: Annotated[float, Field(ge=1.0, allow_inf_nan=False)] | None = None
    note: str = ""

    def rows(self) -> Iterator[tuple[dict[str, str], Settings]]:
        """Yield the names on all axes, and the settings, of every run but for its seed."""
        axes = {name: [*_axis(name, values)] for name, values in self.grid.items()}
        if self.sample is not None:
            axes["sample"] = [*self.sample.rows()]
        for combination in itertools.product(*axes.values()):
            settings = flat(self.set)
            for _, chosen in combination:
                settings |= chosen
            yield {axis: name for axis, (name, _) in zip(axes, combination, strict=True)}, settings

    def all_seeds(self) -> Iterable[int]:
        """Return the seeds."""
        if isinstance(self.seeds, SeedsTable):
            return range(self.seeds.first, self.seeds.first + self.seeds.count)
        return self.seeds


class CampaignTable(Table):
    """A campaign file.

    Attributes:
        title: of its pages.
        part: its parts. What stands beside them (`mission`, `set`, `seeds`, ...) are their defaults.
    """

    title: str = ""
    part: Annotated[tuple[PartTable, ...], Field(strict=False)]


@dataclass(frozen=True)
class Campaign:
    """A campaign file that was read.

    Attributes:
        path: where it is.
        title: of its pages.
        parts: by name.
        sources: a hash over all that its runs may depend on.
        text: the file.
        overrides: settings of all runs, which take the place of all others.
    """

    path: Path
    title: str
    parts: Mapping[str, PartTable]
    sources: str
    text: str
    overrides: Mapping[str, object] = field(default_factory=dict)

    def mission(self, part: PartTable) -> str:
        """Return the mission file of a part as a path that is right here; nothing for drawn configurations."""
        return "" if part.mission == DRAWN else os.path.relpath(self.path.parent / part.mission)

    def jobs(self, part: PartTable) -> Iterator[Job]:
        """Yield the runs of a part without its search: all combinations with the first seed, then with the next."""
        number = itertools.count()
        for seed in part.all_seeds():
            for axes, settings in part.rows():
                yield self.job(part, next(number), {**settings, SEED: seed, **self.overrides}, axes)

    def job(self, part: PartTable, number: int, settings: Settings, axes: Mapping[str, str]) -> Job:
        """Return one run.

        Raises:
            ConfigError: a setting is of a fault that the part's own settings lack.
        """
        settings = _in_faults(settings, str(self.path))
        return Job(
            part.name, number, self.mission(part), settings, axes, part.accept_unproved, part.limit_s,
            folder=str(Path.cwd()), sources=code_hash(), falls_of=part.split.rule if part.split else "",
        )  # fmt: skip


def flat(tables: Mapping[str, Any], above: str = "") -> Settings:
    """Return nested tables as dotted keys; a table that is empty is a value."""
    found: Settings = {}
    for key, value in tables.items():
        # Keys of the outermost table may be dotted ones already.
        name = f"{above}.{_quoted(key)}" if above else key
        found |= flat(value, name) if isinstance(value, dict) and value else {name: value}
    return found


def _in_faults(settings: Settings, source: str) -> Settings:
    """Return settings in which keys such as fault.0.factor stand in the list that they mean."""
    found = {key: value for key, value in settings.items() if not key.startswith("fault.")}
    faults = copy.deepcopy(found.get("fault", []))
    for key in set(settings) - set(found):
        _, number, name = (*key.split(".", 2), "", "")[:3]
        if not number.isdecimal() or int(number) >= len(faults):
            message = f"there is no such fault, allowed: fault.0 to fault.{len(faults) - 1}, of those that are set here"
            raise ConfigError(message, source=source, key=key)
        faults[int(number)][name] = settings[key]
        found["fault"] = faults
    return found


def _quoted(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else f'"{key}"'


def _axis(key: str, values: Axis) -> Iterator[tuple[str, Settings]]:
    if isinstance(values, dict):
        for name, settings in values.items():
            yield name, flat(settings)
    else:
        for value in values:
            yield value if isinstance(value, str) else json.dumps(value), {key: value}


def _with_defaults(part: dict[str, Any], shared: Mapping[str, Any]) -> dict[str, Any]:
    found = {**shared, **part}
    tables = [each["set"] for each in (shared, part) if isinstance(each.get("set"), dict)]
    if len(tables) > 1:
        found["set"] = flat(tables[0]) | flat(tables[1])
    return found


def load_campaign(path: Path, overrides: Mapping[str, object] | None = None, only: str | None = None) -> Campaign:
    """Read a campaign file and check it, with the settings of every run, before anything is run.

    Args:
        path: the file.
        overrides: settings of all runs, by key; they take the place of what the file says.
        only: only parts whose names match this pattern.

    Raises:
        ConfigError: the file, a mission or a setting is not allowed.
    """
    source = str(path)
    data = read_limited(path, "campaign file")
    raw, lines = parse_toml(data, source)
    shared = {key: raw.pop(key) for key in [*raw] if key in PartTable.model_fields and key != "name"}
    parts = raw.get("part")
    if isinstance(parts, list):
        raw["part"] = [_with_defaults(part, shared) if isinstance(part, dict) else part for part in parts]
    try:
        table = CampaignTable.model_validate(raw)
    except ValidationError as failure:
        raise config_error(pydantic_problems(failure, CampaignTable, lines=lines), source) from failure
    by_name = {part.name: part for part in table.part}
    if len(by_name) != len(table.part) or not by_name:
        raise ConfigError("allowed: at least one part, each name once", source=source, key="part.name")
    by_name = {name: part for name, part in by_name.items() if fnmatch(name, only or "*")}
    if not by_name:
        known = ", ".join(part.name for part in table.part)
        raise ConfigError(f"no part matches '{only}', allowed: {known}", source="command line", key="--only")
    missions = [path.parent / part.mission for part in table.part if part.mission != DRAWN]
    for mission in missions:
        read_limited(mission, "mission file")
    sources = sources_hash(missions)
    found = Campaign(path, table.title or path.stem, by_name, sources, data.decode(), overrides or {})
    for index, part in enumerate(table.part):
        if part.repeats and part.repeats not in [each.name for each in table.part]:
            allowed = ", ".join(each.name for each in table.part)
            raise ConfigError(f"it is '{part.repeats}', allowed: {allowed}", source=source, key=f"part.{index}.repeats")
        if part.name in by_name:
            _refuse_wrong(found, part, f"part.{index}", lines.get(("part", str(index))))
    return found


def _refuse_wrong(campaign: Campaign, part: PartTable, key: str, line: int | None) -> None:
    """Refuse a part with settings that no mission takes."""
    source = str(campaign.path)

    def refusal(name: str, message: str) -> ConfigError:
        return ConfigError(message, source=source, line=line, key=f"{key}.{name}")

    if part.search is not None and (part.sample or part.until or part.grid):
        raise refusal("search", "it stands beside sample, until or grid, allowed: a part of its own")
    if part.split is not None:
        if part.search or part.sample or part.until or part.grid or part.mission == DRAWN:
            allowed = "a part of its own, with a mission file"
            raise refusal("split", f"it stands beside search, sample, until, grid or a draw, allowed: {allowed}")
        seeds, repetitions = [*part.all_seeds()], part.split.repetitions
        if len(set(seeds)) < len(seeds) or len(seeds) % repetitions or len(seeds) < 2 * repetitions:
            allowed = f"each once, and for each of the {repetitions} repetitions equally many, 2 or more"
            raise refusal("seeds", f"there are {len(seeds)}, {len(set(seeds))} of them different, allowed: {allowed}")
    seed = next(iter(part.all_seeds()))
    for axes, row in part.rows():
        settings = {**row, SEED: seed, **campaign.overrides}
        if part.search is not None:
            settings |= {name: each.at(0.5) for name, each in part.search.over.items()}
        where = ", ".join(f"{axis} {name}" for axis, name in axes.items())
        try:
            json.dumps(settings, allow_nan=False)
        except (TypeError, ValueError) as failure:
            raise refusal("set", f"{shown_value(settings)}: {failure}; allowed: what JSON has") from failure
        if part.mission == DRAWN:
            unknown = set(settings) - {SEED, "engine", "duration_s"}
            if unknown:
                raise refusal("set", f"it has {', '.join(sorted(unknown))}, allowed: engine, duration_s")
            continue
        try:
            mission = campaign.job(part, 0, settings, axes).load()
            mission.read_workspace()
        except ConfigError as failure:
            raise refusal("set" if not axes else "grid", f"{where}: {failure}" if where else str(failure)) from failure
        if part.split is not None:
            rules = (*RULES, *mission.rta.module)
            if part.split.rule not in rules:
                raise refusal("split.rule", f"it is '{part.split.rule}', allowed: {', '.join(rules)}")
            if mission.reseed or not mission.fault:
                found = "its mission has [[reseed]] already" if mission.reseed else "its mission has no [[fault]]"
                raise refusal("split", f"{found}, allowed: faults whose random numbers only the campaign draws anew")
        if not _in_virtual_time(mission):
            allowed = "a backend in virtual time, such as kinematic: only there a seed gives one run"
            raise refusal("set.backend", f"it is '{mission.backend}', allowed: {allowed}")


def _in_virtual_time(mission: MissionFile) -> bool:
    return load_backend(mission.backend, to_open=False).robot_class.declared.in_process

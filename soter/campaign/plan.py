"""Reads campaign files: missions and settings of runs, their requirements, and stopping rules."""

from __future__ import annotations

import copy
import itertools
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from soter.campaign.job import Job
from soter.campaign.sources import code_hash, sources_hash
from soter.campaign.tables import DRAWN, SEED, CampaignTable, PartTable, Settings, flat
from soter.errors import ConfigError
from soter.problems import config_error, parse_toml, pydantic_problems, read_limited, shown_value
from soter.registry import in_virtual_time
from soter.sdk import RULES


@dataclass(frozen=True)
class Campaign:
    """A campaign file that was read.

    Attributes:
        title: title of its pages.
        sources: a hash over all that its runs may depend on.
        text: the file's text.
        overrides: settings of all runs, which override all others.
    """

    path: Path
    title: str
    parts: Mapping[str, PartTable]
    sources: str
    text: str
    overrides: Mapping[str, object] = field(default_factory=dict)

    def mission(self, part: PartTable) -> str:
        """Return the mission file of a part relative to the working directory; empty for drawn configurations."""
        return "" if part.mission == DRAWN else os.path.relpath(self.path.parent / part.mission)

    def jobs(self, part: PartTable) -> Iterator[Job]:
        """Yield the runs of a part without those of its search: all combinations with the first seed, then the next."""
        number = itertools.count()
        for seed in part.all_seeds():
            for axes, settings in part.rows():
                yield self.job(part, next(number), {**settings, SEED: seed, **self.overrides}, axes)

    def job(self, part: PartTable, number: int, settings: Settings, axes: Mapping[str, str]) -> Job:
        """Return one run.

        Raises:
            ConfigError: a setting belongs to a fault that the part's own settings lack.
        """
        settings = _in_faults(settings, str(self.path))
        return Job(
            part.name, number, self.mission(part), settings, axes, part.accept_unproved, part.limit_s,
            folder=str(Path.cwd()), sources=code_hash(), falls_of=part.split.rule if part.split else "",
        )  # fmt: skip


def _in_faults(settings: Settings, source: str) -> Settings:
    """Return settings with keys such as fault.0.factor moved into the list of faults."""
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
        overrides: settings of all runs, by key, which override the file's.
        only: a pattern; other parts are left out.

    Raises:
        ConfigError: the file, a mission or a setting is not allowed.
    """
    source = str(path)
    data = read_limited(path, "campaign file")
    raw, lines = parse_toml(data, source, "campaign file")
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
    """Refuse a part whose settings contradict each other, or that its mission does not take."""
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
        if not in_virtual_time(mission.backend):
            allowed = "a backend in virtual time, such as kinematic: only there a seed gives one run"
            raise refusal("set.backend", f"it is '{mission.backend}', allowed: {allowed}")

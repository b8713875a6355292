"""The tables of a campaign file: parts, axes, samples, searches, and importance splitting."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from random import Random
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from soter.campaign.conditions import Requirement, StoppingRule
from soter.config.table import Name, Table, table_or_list, wrong
from soter.config.toml_text import toml_key

SEED: Final = "seed"
DRAWN: Final = "random"
"""The mission of a part whose configurations are drawn; see `soter.campaign.random`."""

Settings = dict[str, Any]
Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]
Number = Annotated[float, Field(allow_inf_nan=False)]


class SeedsTable(Table):
    """Consecutive seeds, `count` of them."""

    first: Seed = 1
    count: Count


class RangeTable(Table):
    """A range from which a number is drawn, or that is searched.

    Attributes:
        log: whether to draw evenly over the logarithm.
        whole: whether to draw whole numbers only.
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
        # Rounded, so that a command line can repeat the number.
        return round(value) if self.whole else float(f"{min(max(value, self.low), self.high):.9g}")


def _ranges(tables: object) -> object:
    """Validate nested tables of ranges, for pydantic; return ranges by dotted key."""
    return flat(tables, ends=("low", "high")) if isinstance(tables, dict) else tables


class SampleTable(Table):
    """Settings that are drawn at random.

    Attributes:
        count: how many times.
        seed: the seed of the draws; a larger count does not change the first draws.
        draw: by key, a range or a list of values.
    """

    count: Count
    seed: Seed = 0
    draw: Annotated[
        dict[str, Annotated[RangeTable | list[Any], table_or_list(RangeTable, Any)]], BeforeValidator(_ranges)
    ]

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
        over: the searched ranges, by key.
        seed: the optimiser's seed.
        below: the search ends at the first run in which the figure is below this; None for never.
        by: CMA-ES, or random for comparison.
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
        rule: a safety module, or a user's own rule.
        below: the value, in the margin's unit.
        repetitions: how many independent estimates are made; the seeds are shared out among them.
        at_most: the bound on the share of runs, for the upper end of its interval; None for no requirement.
    """

    rule: Name
    below: Number = 0.0
    repetitions: Annotated[int, Field(ge=5, le=1000)] = 10
    at_most: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None


Axis = list[Any] | dict[str, dict[str, Any]]
"""Values of the key that the axis is named after; or settings of several keys, by a name."""


def _axes(tables: object) -> object:
    """Refuse an axis named by a dotted key without quotation marks, which TOML reads as tables; for pydantic."""
    for name, values in tables.items() if isinstance(tables, dict) else ():
        for key, value in values.items() if isinstance(values, dict) else ():
            if not isinstance(value, dict):
                raise wrong((name, key), value, f'a table; if the axis is of one key: grid."{name}.{key}" = [...]')
    return tables


class PartTable(Table):
    """Runs that belong together.

    Attributes:
        mission: the mission file, relative to the campaign's; or "random", which draws configurations from the seeds.
        set: values by key for all its runs; nested tables are read as dotted keys.
        grid: axes, of which every combination is run.
        sample: settings that are drawn; each draw is run with every combination of the grid.
        seeds: each combination is run with each of them.
        require: requirements of its runs; see `soter.campaign.conditions`.
        until: the stopping rule that ends the part; see there.
        repeats: the part whose runs these must repeat bit for bit.
        search: looks for the worst over declared ranges.
        split: estimates how often a rare event happens.
        may_refuse: whether runs may be refused as ill-formed or not proved.
        accept_unproved: whether to run what cannot be proved, as by `soter run --accept-unproved`.
        limit_s: host time that one run may take.
        note: a note for its table in reports.
    """

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
    mission: Name
    set: dict[str, Any] = Field(default_factory=dict)
    grid: Annotated[dict[str, Axis], BeforeValidator(_axes)] = Field(default_factory=dict)
    sample: SampleTable | None = None
    seeds: Annotated[SeedsTable | list[Seed], table_or_list(SeedsTable, Seed)] = Field(default=[1])
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
        """Yield the axes' values and the settings of every run, without the seed."""
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
        title: title of its pages.
        part: its parts. Keys beside them (`mission`, `set`, `seeds`, ...) are their defaults.
    """

    title: str = ""
    part: Annotated[tuple[PartTable, ...], Field(strict=False)]


def flat(tables: Mapping[str, Any], above: str = "", ends: Collection[str] = ()) -> Settings:
    """Return nested tables as dotted keys; an empty table, or one with a key in `ends`, is a value."""
    found: Settings = {}
    for key, value in tables.items():
        # Keys of the outermost table may already be dotted.
        name = f"{above}.{toml_key(key)}" if above else key
        is_table = isinstance(value, dict) and value and not value.keys() & ends
        found |= flat(value, name, ends) if is_table else {name: value}
    return found


def _axis(key: str, values: Axis) -> Iterator[tuple[str, Settings]]:
    if isinstance(values, dict):
        for name, settings in values.items():
            yield name, flat(settings)
    else:
        for value in values:
            yield value if isinstance(value, str) else json.dumps(value), {key: value}

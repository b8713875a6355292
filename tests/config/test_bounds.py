"""Every number of a mission has a least and a largest value; between them it runs, beyond them it is refused."""

from __future__ import annotations

import math
import types
from collections.abc import Iterator
from functools import partial
from itertools import count
from typing import Any, Union, get_args, get_origin

import pytest
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel

from soter.config import MissionFile, load_mission
from soter.errors import BackendError, ConfigError, IllFormedModule
from soter.runner import Follower, run_mission
from tests.project.source import ROOT

MISSION = ROOT / "examples" / "surveillance.toml"
QUICK = {"backend": "kinematic", "planner": "straight-line"}
TICKS = 4
WITH = {"rta.path": {"rta.path.enabled": True}}
"""What has to be there for a key to mean anything."""

LISTED = {
    "station": {"x_m": 1.0, "y_m": 1.0},
    "start": {"id": 1, "x_m": 1.0, "y_m": 1.0},
    "reseed": {"at_s": 1.0, "seed": 1},
}
"""The same of tables that a mission has a list of."""


def numbers(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, type, list[Any]]]:
    """Dotted key, type and bounds of every number of a model and of the models in it."""
    for name, field in model.model_fields.items():
        yield from _found(field.annotation, list(field.metadata), prefix + name)


def _found(annotation: Any, bounds: list[Any], key: str) -> Iterator[tuple[str, type, list[Any]]]:
    if hasattr(annotation, "__metadata__"):
        for each in annotation.__metadata__:
            bounds = [*bounds, *getattr(each, "metadata", [each])]
        annotation = annotation.__origin__
    if annotation in (int, float):
        yield key, annotation, bounds
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield from numbers(annotation, f"{key}.")
    elif get_origin(annotation) in (Union, types.UnionType):
        for each in get_args(annotation):
            yield from _found(each, bounds, key)
    elif get_origin(annotation) is dict:
        yield from _found(get_args(annotation)[1], [], f"{key}.1")
    elif get_origin(annotation) is tuple:
        yield from _found(get_args(annotation)[0], [], f"{key}.0")


NUMBERS = {key: (kind, bounds) for key, kind, bounds in numbers(MissionFile)}


def limits(key: str) -> tuple[float, float]:
    """The least and the largest value of a key; where it may not be reached, the next one."""
    kind, bounds = NUMBERS[key]
    least, most = -math.inf, math.inf
    for each in bounds:
        if isinstance(each, Ge):
            least = each.ge  # type: ignore[assignment]
        elif isinstance(each, Gt):
            least = each.gt + 1 if kind is int else math.nextafter(each.gt, math.inf)  # type: ignore[operator, arg-type]
        elif isinstance(each, Le):
            most = each.le  # type: ignore[assignment]
        elif isinstance(each, Lt):
            most = each.lt - 1 if kind is int else math.nextafter(each.lt, -math.inf)  # type: ignore[operator, arg-type]
    return least, most


def test_the_numbers_are_found() -> None:
    assert {"base_tick_s", "seed", "robots.count", "battery.initial.1", "rta.collision.delta_s"} <= set(NUMBERS)
    assert len(NUMBERS) > 30


@pytest.mark.parametrize("key", NUMBERS)
def test_every_number_has_a_least_and_a_largest_value(key: str) -> None:
    least, most = limits(key)
    assert -math.inf < least < most < math.inf
    assert least <= 0.0 or least >= 1e-6, "sums of steps this small stand still, and quotients are infinite"


def _over(turns: Iterator[int]) -> bool:
    return next(turns) >= TICKS


def loaded(key: str, value: object) -> MissionFile:
    given = next((more for prefix, more in WITH.items() if key.startswith(prefix)), {})
    if ".0." in key:
        table, _, name = key.partition(".0.")
        return load_mission(MISSION, {**QUICK, table: [{**LISTED[table], name: value}]})
    return load_mission(MISSION, {**QUICK, **given, key: value})


OF_MODELS = [key for key in NUMBERS if not key.startswith("distribution.processes")]


@pytest.mark.parametrize("key", OF_MODELS)
def test_what_is_beyond_is_refused_with_key_value_and_what_is_allowed(key: str) -> None:
    kind, _ = NUMBERS[key]
    least, most = limits(key)
    beyond: list[Any] = [10**400, -(10**400), math.nan, math.inf, -math.inf, 1e300, -1e300]
    beyond += (
        [least - 1, most + 1] if kind is int else [math.nextafter(least, -math.inf), math.nextafter(most, math.inf)]
    )
    for value in beyond:
        with pytest.raises(ConfigError) as refused:
            loaded(key, value)
        # TOML's own way to say which robot's charge it is has no name of its own.
        assert key.removesuffix(".1") in str(refused.value)
        assert "allowed: " in str(refused.value)


@pytest.mark.parametrize("key", OF_MODELS)
def test_what_is_allowed_runs_or_is_refused(key: str) -> None:
    kind, _ = NUMBERS[key]
    least, most = limits(key)
    for value in {least, most, *(x for x in (1e-320, 1e-9, 1e-3, 1.0, 1e3) if kind is float and least < x < most)}:
        try:
            mission = loaded(key, value)
            result = run_mission(mission, follower=Follower(stop=partial(_over, count()))).result
        except (BackendError, ConfigError, IllFormedModule) as refused:
            assert str(refused)  # noqa: PT017 - with a sentence
        else:
            assert result.status in {"completed", "interrupted"}
            assert math.isfinite(result.ac_share)

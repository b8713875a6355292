"""Refuses declarations of the user's own that no condition can be asked about, or that answer what cannot be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from numbers import Real
from types import UnionType
from typing import Final

from soter.errors import ConfigError, IllFormedModule
from soter.problems import shown_value
from soter.rta import Node, ReachModel, Region, RTAModule, Timing
from soter.rta.module import plain

LONGEST_DELTA_S: Final = 60.0
"""Longest Delta, as in the tables of the shipped modules."""

LONGEST_HOLD_S: Final = 3600.0
"""Longest `lets_go_s`."""

_NUMBER: Final = (Real, "a number")
_TYPES: Final[Mapping[str, tuple[type | UnionType, str]]] = {
    **dict.fromkeys(("delta_s", "dwell_s", "keep", "lets_go_s", "peers_within_m"), _NUMBER),
    "ac": (Node, "a soter.Node, such as kit.ac"),
    "phi_safe": (Region | None, "a soter.Region"),
    "phi_safer": (Region, "a soter.Region, or a function of the situation"),
    "model": (ReachModel | None, "a reach model, such as kit.model"),
}
"""By field, what it has to be, and that in words. What a safe controller lacks shows as it is wrapped."""


def check_usable(
    made: RTAModule, name: str, target: str, timing: Timing, refused: Callable[[str], ConfigError]
) -> None:
    """Refuse a declaration whose fields are of other types, or whose figures make a condition say nothing.

    What is kept for the safe controller, the noise of a margin, and how far it can fall, are taken from the margin:
    below 0 they would add to it, and the module would never fire.

    Args:
        made: the declaration.
        name: the module's name in the mission.
        target: what declares it.
        timing: of the robot.
        refused: makes the error.

    Raises:
        ConfigError: a field is of another type.
        IllFormedModule: a figure is not allowed.
    """
    for field, allowed in _of_other_types(made):
        raise refused(f"'{target}' gives {shown_value(getattr(made, field))} as {field}, allowed: {allowed}")
    if made.delta_s > LONGEST_DELTA_S and math.isfinite(made.delta_s):
        raise IllFormedModule(
            name, "P1a", f"delta_s is {made.delta_s:g}, allowed: above 0, at most {LONGEST_DELTA_S:g}"
        )
    if LONGEST_HOLD_S < made.lets_go_s < math.inf:
        raise IllFormedModule(name, "P2c", f"lets_go_s is {made.lets_go_s:g}, allowed: 0 to {LONGEST_HOLD_S:g}")
    for what, ask in _figures(made, timing):
        try:
            figure = plain(ask())
        except KeyboardInterrupt:
            raise
        except BaseException:  # noqa: BLE001, S112 - foreign code; the conditions ask again, and say how it failed
            continue
        if not figure >= 0.0:
            raise IllFormedModule(name, "P3", f"{what} is {figure:g}, allowed: 0 or more")


def _figures(made: RTAModule, timing: Timing) -> Iterator[tuple[str, Callable[[], float]]]:
    """Yield what is taken from the margin: in words, and how to ask for it."""
    phi_safe, model = made.phi_safe, made.model
    yield "keep", lambda: made.keep
    if phi_safe is not None:
        yield "the noise of phi_safe", lambda: phi_safe.noise(timing.noise_m)
    if model is not None:
        yield "the bound of the model", lambda: model.bound(made.horizon_s(timing))


def _of_other_types(made: RTAModule) -> Iterator[tuple[str, str]]:
    """Yield the fields that are of other types than they have to be, with what is allowed."""
    for field, (types, allowed) in _TYPES.items():
        value: object = getattr(made, field)
        if not (isinstance(value, types) or (field == "phi_safer" and callable(value))):
            yield field, allowed
        elif isinstance(value, Real) and not _fits(value):
            yield field, "a number that a float can hold"


def _fits(value: Real) -> bool:
    try:
        plain(value)
    except (TypeError, ValueError, OverflowError):
        return False
    return True

"""What keeps a boat near where it has stopped: ArduRover, as its parameters let it.

ArduRover holds a boat once it has come to its place, or has heard of no heading and no velocity for 3 s: the boat
drifts within LOIT_RADIUS of where it was then, and is driven back from beyond. WP_RADIUS is how near to a place counts
as there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from soter.sdk import Capabilities

UNHELD_S: Final = 5.0
"""How long at most a boat drifts as fast as it may: 3 s until it is held, and while it turns to be driven back."""

_THRUST: Final = {73.0, 74.0}
"""The functions of motors on the left and on the right, with which a boat turns in place."""

_OUTPUTS: Final = tuple(f"SERVO{number}_FUNCTION" for number in range(1, 9))
_HELD: Final = ("FRAME_CLASS", "LOIT_RADIUS", "WP_RADIUS")
"""Without these nothing is known of how it is held."""

_LETS_GO: Final = "it would stop its motors, and let the boat drift off"
_ALLOWED: Final[Mapping[str, tuple[tuple[float, ...], str]]] = {
    "FRAME_CLASS": ((2.0,), "only a boat is held where it has stopped"),
    "LOIT_TYPE": ((0.0,), "it turns round before it is driven back, and drifts on for as long"),
    "SAIL_ENABLE": ((0.0,), "a sail drives it where it has stopped"),
    "FS_ACTION": ((0.0, 6.0), _LETS_GO),
    "BATT_FS_LOW_ACT": ((0.0, 6.0), _LETS_GO),
    "BATT_FS_CRT_ACT": ((0.0, 6.0), _LETS_GO),
    "FS_CRASH_CHECK": ((0.0,), f"one that is held against a current counts as crashed, and {_LETS_GO}"),
}
_GAIN: Final = "LOIT_SPEED_GAIN"
_GAINS: Final = 0.5, 1.0
"""By which ArduRover drives it back: with less it gets farther, with more faster than one that stands may be."""

NAMES: Final = (*_HELD, *(name for name in _ALLOWED if name not in _HELD), _GAIN, *_OUTPUTS)
"""The parameters that are judged."""


def drift_m(parameters: Mapping[str, float], promised: Capabilities) -> float:
    """Return how far from where it has stopped a boat gets, by the parameters that it has reported.

    What is promised to show at rest is as fast as it may drift.
    """
    radii_m = parameters.get("LOIT_RADIUS", 0.0) + parameters.get("WP_RADIUS", 0.0)
    return radii_m + UNHELD_S * (promised.speed_noise_m_s or 0.0)


def why_refused(parameters: Mapping[str, float], promised: Capabilities) -> str:
    """Return which parameter does not hold a boat as is promised, and values that would; empty if all do."""
    for name in _HELD:
        if name not in parameters:
            return f"it does not say its {name}; allowed: a boat whose {', '.join(_HELD)} can be read"
    for name, (values, why) in _ALLOWED.items():
        value = parameters.get(name)
        # Also refuses NaN, here and below.
        if value is not None and value not in values:
            return f"its {name} is {value:g}: {why}; allowed: {' or '.join(f'{each:g}' for each in values)}"
    gain = parameters.get(_GAIN)
    if gain is not None and not _GAINS[0] <= gain <= _GAINS[1]:
        return f"its {_GAIN} is {gain:g}, allowed for a boat: {_GAINS[0]:g} to {_GAINS[1]:g}"
    return _cannot_turn(parameters) or _drifts_far(parameters, promised)


def _cannot_turn(parameters: Mapping[str, float]) -> str:
    functions = [parameters[name] for name in _OUTPUTS if name in parameters]
    if set(functions) >= _THRUST:
        return ""
    return (
        f"its SERVO1_FUNCTION to SERVO8_FUNCTION are {', '.join(f'{each:g}' for each in functions) or 'not told'}: it "
        "has no motors on either side, and cannot turn in place; safe controllers do; allowed: 73 for one of them and "
        "74 for another"
    )


def _drifts_far(parameters: Mapping[str, float], promised: Capabilities) -> str:
    most_m, noise_m, tube_m = drift_m(parameters, promised), promised.position_noise_m, promised.tube_m
    if most_m < noise_m and most_m <= tube_m:
        return ""
    drifts_m_s = promised.speed_noise_m_s or 0.0
    return (
        f"its LOIT_RADIUS is {parameters['LOIT_RADIUS']:g} and its WP_RADIUS {parameters['WP_RADIUS']:g}: with "
        f"{UNHELD_S:g} s at promise.speed_noise_m_s = {drifts_m_s:g} it drifts by {most_m:g} m, and "
        f"promise.position_noise_m is {noise_m:g} and promise.tube_m {tube_m:g}; allowed: together less than "
        f"{max(min(noise_m, tube_m) - UNHELD_S * drifts_m_s, 0.0):g}, or larger promises"
    )

"""Draws `[[fault]]` tables that are declared, each within what its kind may declare."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random
from typing import Any, Final

Table = dict[str, Any]

KILLED_S: Final = 30.0
"""Longest time for which a robot is dead: no promise can cover one whose battery runs out on its way."""


def draw_faults(rng: Random, ids: Sequence[int], nasty: bool) -> list[Table]:
    """Return up to three faults; half of the draws have two or more."""
    count = rng.choices((0, 1, 2, 3), (0.25, 0.25, 0.3, 0.2))[0]
    kinds = rng.sample([*KINDS], count) if rng.random() < 0.8 else rng.choices([*KINDS], k=count)
    # Several faults add up, so that each must be smaller for modules to cover them all.
    scale = (1.0 if nasty else 0.6) / max(1, count)
    return [_with_times(rng, kind, KINDS[kind](rng, scale), ids) for kind in kinds]


def _with_times(rng: Random, kind: str, parameters: Table, ids: Sequence[int]) -> Table:
    table: Table = {"kind": kind, **parameters}
    if rng.random() < 0.4:
        table["robot"] = rng.choice(ids)
    elif rng.random() < 0.2:
        table["robot"] = "all"
    if "duration_s" not in table and rng.random() < 0.4:
        table["duration_s"] = round(rng.uniform(1.0, 60.0), 2)
    if "duration_s" in table and "every_s" not in table and rng.random() < 0.8:
        table["every_s"] = round(table["duration_s"] + rng.uniform(0.5, 60.0), 2)
    if "start_s" not in table and rng.random() < 0.4:
        table["start_s"] = round(rng.uniform(0.0, 120.0), 2)
    if rng.random() < 0.15:
        table["declared"] = True
    return table


def _delay(rng: Random, scale: float) -> Table:
    amount = {name: _part(rng, 0.1 * scale) for name in ("commands_s", "samples_s")}
    amount["jitter_s"] = _part(rng, 0.05 * scale)
    kept = rng.sample([*amount], rng.randint(1, 3))
    return {name: value for name, value in amount.items() if name in kept}


def _loss(rng: Random, scale: float) -> Table:
    table: Table = _either(rng, 0.5)
    if rng.random() < 0.3:
        table["burst"] = 1 if scale < 0.6 else 2
    if rng.random() < 0.2:
        table["resend"] = True
    return table


def _duplicate(rng: Random, scale: float) -> Table:
    table = _either(rng, 0.5)
    if rng.random() < 0.6:
        table["after_s"] = _part(rng, 0.08 * scale)
    if rng.random() < 0.2:
        table["reorder"] = False
    return table


def _freeze(rng: Random, scale: float) -> Table:
    restamped = rng.random() < 0.5
    lasts_s = _part(rng, 0.3 * scale if restamped else 0.1 * scale) + 0.01
    table: Table = {"duration_s": round(lasts_s, 3), "every_s": round(lasts_s + rng.uniform(0.3, 5.0), 2)}
    return {**table, "restamped": True} if restamped else table


def _bias(rng: Random, scale: float) -> Table:
    table: Table = {}
    if rng.random() < 0.8:
        table["x_m"] = round(rng.uniform(-0.08, 0.08) * scale, 3) or 0.01
    if rng.random() < 0.6:
        table["y_m"] = round(rng.uniform(-0.08, 0.08) * scale, 3) or -0.01
    if rng.random() < 0.3 or not table:
        table["heading_rad"] = round(rng.uniform(-0.5, 0.5), 3) or 0.1
    return table


def _clock_step(rng: Random, scale: float) -> Table:
    step_s = round(rng.uniform(0.01, 0.12) * scale, 3) * rng.choice((-1.0, 1.0))
    lasts_s = round(rng.uniform(5.0, 30.0), 1)
    return {"step_s": step_s, "duration_s": lasts_s, "every_s": round(lasts_s + rng.uniform(5.0, 60.0), 1)}


def _battery(rng: Random, scale: float) -> Table:
    return {"offset": -round(rng.uniform(0.01, 0.3) * scale, 3)}


def _wheel_slip(rng: Random, scale: float) -> Table:
    # Mostly little, and now and then so much that the return path takes several times as long.
    left = round(0.99 - 0.85 * scale * rng.random() ** 2, 3)
    right = round(min(1.0, left + rng.uniform(-0.05, 0.05) * min(1.0, scale)), 3)
    return {"left": left, "right": right} if rng.random() < 0.8 else {"left": round(rng.uniform(0.95, 0.99), 3)}


def _weak_brakes(rng: Random, scale: float) -> Table:
    return {"factor": round(rng.uniform(1.0 - 0.6 * scale, 0.99), 3)}


def _kill(rng: Random, _scale: float) -> Table:
    lasts_s = round(rng.uniform(1.0, KILLED_S), 1)
    # Not before the robot is ready.
    return {
        "start_s": round(rng.uniform(1.0, 300.0), 1),
        "duration_s": lasts_s,
        "every_s": round(lasts_s + rng.uniform(120.0, 600.0), 1),
    }


def _part(rng: Random, most: float) -> float:
    return max(0.001, round(rng.uniform(0.05, 1.0) * most, 3))


def _either(rng: Random, most: float) -> Table:
    names = rng.choice((("commands",), ("samples",), ("commands", "samples")))
    return {name: round(rng.uniform(0.01, most), 3) for name in names}


KINDS: Final[dict[str, Callable[[Random, float], Table]]] = {
    "delay": _delay,
    "loss": _loss,
    "duplicate": _duplicate,
    "freeze": _freeze,
    "bias": _bias,
    "clock_step": _clock_step,
    "battery": _battery,
    "wheel_slip": _wheel_slip,
    "weak_brakes": _weak_brakes,
    "kill": _kill,
}
"""By kind: draws the kind's own parameters, given the random numbers and the share of its range to use."""

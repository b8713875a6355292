"""Judges the robots of a world by the rules: exactly, and only when something can have changed.

Both engines move robots along straight chords, one per step. At each look the judge computes how many steps robots need
at least, at top speed, before a margin can fall below its least value so far, or a rule can be broken or hold again.
Until then there is nothing to see, so nothing is missed, and most steps cost one comparison.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, Final

from soter.geometry.workspace import Workspace
from soter.sdk.values import RuleLimits
from soter_sim.bodies import Bodies
from soter_sim.boxes import NEAR_M, Boxes, obstacles_of
from soter_sim.fences import fence_of
from soter_sim.sweep import (
    inside_disc,
    nearest_to_origin,
    point_to_box,
)
from soter_sim.truth import FENCE_TOLERANCE_M, PENETRATION_M, TOUCH_M, Record

REBUILD_STEPS: Final = 32
"""Steps after which the list of pairs that are near enough to be judged is made anew."""

Stops = dict[int, float]
"""By robot, the part of the step after which it was stopped by an impact."""


class Pair:
    """Two robots that are, or soon may be, near each other.

    Attributes:
        i: the first robot's index.
        j: the second's, larger.
        due: the step at which to judge them next.
        apart_m: nearer than this they are in collision.
        contact_m: nearer than this their bodies overlap.
    """

    __slots__ = ("apart_m", "contact_m", "due", "i", "j")

    def __init__(self, i: int, j: int, due: int, apart_m: float, contact_m: float) -> None:
        self.i, self.j, self.due, self.apart_m, self.contact_m = i, j, due, apart_m, contact_m


class Judge:
    """Applies the rules of `soter_sim.truth` to chords.

    Args:
        workspace: fence, boxes and chargers.
        bodies: the robots, at their places at time 0.
        step_s: duration of a step.
        speed_m_s: top speed of all robots.
        limits: what the mission promises.

    Attributes:
        due: the first step at which a look is needed.
        boxes: the obstacles.
        box_due: by robot, the first step at which it may touch a box.
        on_charger: by robot, whether its centre is on a charger.
        pairs: the pairs that may come near each other before the list is made anew.
        record: the findings.
    """

    def __init__(
        self, workspace: Workspace, bodies: Bodies, step_s: float, speed_m_s: float, limits: RuleLimits
    ) -> None:
        self._x, self._y, self._ids = bodies.x, bodies.y, bodies.ids
        self._count = len(bodies.ids)
        self._step_s = step_s
        # Slightly more than the longest chord, so that rounding cannot make a look come late.
        self._reach_m = speed_m_s * step_s * (1.0 + 1e-9)
        self._radius = bodies.radius
        self._separation_m = limits.separation_m
        # Least distances from boxes: of centres, and of bodies.
        self._keep = [radius_m + limits.clearance_m for radius_m in bodies.radius]
        self._clear = [keep_m - radius_m for keep_m, radius_m in zip(self._keep, bodies.radius, strict=True)]
        self._fence = fence_of(workspace, FENCE_TOLERANCE_M)
        self.boxes = obstacles_of(workspace)
        self._chargers = Boxes(place.charger for place in workspace.robots)
        self._touches_box = [False] * self._count
        self._touching: set[tuple[int, int]] = set()
        self._static_due = [0] * self._count
        self._rebuild = 0
        self.box_due = [0] * self._count
        self.pairs: list[Pair] = []
        self.on_charger = [False] * self._count
        self.record = Record([], {}, {"battery": inf, "geofence": inf, "collision": inf, "obstacle": inf})
        self.due = 0
        self._begin(bodies)

    # --- what engines report -------------------------------------------------------------------------------

    def flat(self, index: int, at_s: float) -> None:
        """Record that a robot's charge is 0 at `at_s`, away from a charger."""
        self.record.begin("battery", (self._ids[index],), at_s)

    def charged(self, index: int, at_s: float) -> None:
        """Record that a robot that was flat stands on a charger."""
        self.record.end("battery", (self._ids[index],), at_s)

    def hit_box(self, index: int, at_s: float) -> None:
        """Record that a robot was stopped by a box, or presses against one."""
        if not self._touches_box[index]:
            self._touches_box[index] = True
            self.record.box_contacts += 1
            self.record.begin("obstacle", (self._ids[index],), at_s)

    def hit_robot(self, first: int, second: int, at_s: float) -> None:
        """Record that a robot was stopped by another, or that they press against each other."""
        pair = (first, second)
        if pair not in self._touching:
            self._touching.add(pair)
            self.record.robot_contacts += 1
            self.record.begin("collision", (self._ids[first], self._ids[second]), at_s)

    # --- looking -------------------------------------------------------------------------------------------

    def look(self, step: int, to_x: list[float], to_y: list[float], stops: Stops | None = None) -> None:
        """Judge one step, in which each robot moved from `bodies` to (`to_x`, `to_y`); called before `bodies` changes.

        Args:
            step: the step's number; it began at `step * step_s`.
            to_x: where each robot is at the end of the step, east.
            to_y: where each robot is at the end of the step, north.
            stops: the robots that were stopped on the way.
        """
        static_due = self._static_due
        for index in range(self._count):
            if static_due[index] <= step:
                self._look_at_place(index, step, to_x[index], to_y[index], stops)
        for pair in self.pairs:
            if pair.due <= step:
                self._look_at_pair(pair, step, to_x, to_y, stops)
        if self._rebuild <= step + 1:
            self._find_pairs(step + 1, to_x, to_y)
        due = min(static_due)
        if self._rebuild <= due:
            due = self._rebuild - 1
        for pair in self.pairs:
            if pair.due < due:
                due = pair.due
        self.due = due

    def _look_at_place(self, index: int, step: int, x1: float, y1: float, stops: Stops | None) -> None:
        x0, y0 = self._x[index], self._y[index]
        reach, keep_m = self._reach_m, self._keep[index]
        least = self.record.min_margin
        margin = self._fence.margin(x0, y0, x1, y1)
        if margin < least["geofence"]:
            least["geofence"] = margin
        if margin < -FENCE_TOLERANCE_M or (self.record.open and ("geofence", (self._ids[index],)) in self.record.open):
            self._look_at_fence(index, step, x0, y0, x1, y1, 1.0 if stops is None else stops.get(index, 1.0))
        # Without a fence both are infinite, and so is the slack.
        slack = inf if margin == inf else max(margin - max(least["geofence"], -FENCE_TOLERANCE_M), 0.0)

        # Far boxes may be left out only while they cannot have the least clearance.
        care = max(least["obstacle"], TOUCH_M)
        seen_m = max(care + keep_m + reach, NEAR_M)
        boxes = self.boxes.near(x1, y1, seen_m)
        near = inf if boxes is self.boxes.all else seen_m
        for box in boxes:
            gap = self.boxes.point_to(x1, y1, box)
            if gap < near:
                near = gap
        clearance = near - keep_m
        if clearance - reach < care or self._touches_box[index]:
            self._look_at_boxes(index, step, x0, y0, x1 - x0, y1 - y0, boxes, clearance)
            care = max(least["obstacle"], TOUCH_M)
        slack = min(slack, max(clearance - care, 0.0))
        self.box_due[index] = step + 1 + int(max(min(clearance, NEAR_M), 0.0) / reach)

        on_charger = False
        slack = min(slack, NEAR_M)
        for charger in self._chargers.near(x1, y1):
            gap = point_to_box(x1, y1, charger)
            if gap <= 0.0:
                on_charger = True
                gap = -gap
            if gap < slack:
                slack = gap
        self.on_charger[index] = on_charger
        self._static_due[index] = min(step + 1 + int(slack / reach), self.box_due[index])

    def _look_at_fence(self, index: int, step: int, x0: float, y0: float, x1: float, y1: float, stop: float) -> None:
        robots = (self._ids[index],)
        # A robot that was stopped covered its chord within the first part of the step.
        at_s, lasts_s = step * self._step_s, stop * self._step_s
        parts = self._fence.outside(x0, y0, x1 - x0, y1 - y0)
        if not parts or parts[0][0] > 0.0:
            self.record.end("geofence", robots, at_s)
        for first, last in parts:
            self.record.begin("geofence", robots, at_s + first * lasts_s)
            if last < 1.0:
                self.record.end("geofence", robots, at_s + last * lasts_s)

    def _look_at_boxes(
        self, index: int, step: int, x0: float, y0: float, dx: float, dy: float,
        boxes: tuple[Any, ...], clearance: float,
    ) -> None:  # fmt: skip
        swept = min((self.boxes.chord_to(x0, y0, dx, dy, box) for box in boxes), default=inf) - self._keep[index]
        clear_m = self._clear[index]
        least, robots = self.record.min_margin, (self._ids[index],)
        if swept < least["obstacle"]:
            least["obstacle"] = swept
        if swept + clear_m < -PENETRATION_M:
            self.hit_box(index, step * self._step_s)
        if swept < 0.0 < clear_m:
            self.record.begin("obstacle", robots, step * self._step_s)
        if self._touches_box[index] and clearance + clear_m > TOUCH_M:
            self._touches_box[index] = False
        if clearance >= 0.0 and not self._touches_box[index]:
            self.record.end("obstacle", robots, (step + 1) * self._step_s)

    def _find_pairs(self, step: int, x: list[float], y: list[float]) -> None:
        """List the pairs that may come into contact, into collision or to the least margin before the next listing."""
        self._rebuild = step + REBUILD_STEPS
        if self._count < 2:
            return
        reach, radius, separation_m = 2.0 * self._reach_m, self._radius, self._separation_m
        spare_m = max(self.record.min_margin["collision"], 0.0)
        near = max(separation_m, 2.0 * max(radius)) + spare_m + REBUILD_STEPS * reach
        near_sq = near * near
        order = sorted(range(self._count), key=x.__getitem__)
        pairs: list[Pair] = []
        for place, first in enumerate(order):
            x_first, y_first = x[first], y[first]
            for other in range(place + 1, len(order)):
                second = order[other]
                dx = x[second] - x_first
                if dx > near:
                    break
                dy = y[second] - y_first
                distance_sq = dx * dx + dy * dy
                if distance_sq <= near_sq:
                    contact_m = radius[first] + radius[second]
                    apart_m = max(separation_m, contact_m)
                    due = step + int(max(sqrt(distance_sq) - (apart_m + spare_m), 0.0) / reach)
                    pairs.append(Pair(min(first, second), max(first, second), due, apart_m, contact_m))
        # Sorted, so that the findings of one step are in the same order wherever the robots are.
        pairs.sort(key=lambda pair: (pair.i, pair.j))
        self.pairs = pairs

    def _look_at_pair(self, pair: Pair, step: int, to_x: list[float], to_y: list[float], stops: Stops | None) -> None:
        i, j, apart_m = pair.i, pair.j, pair.apart_m
        x, y = self._x, self._y
        rx, ry = x[j] - x[i], y[j] - y[i]
        end_x, end_y = to_x[j] - to_x[i], to_y[j] - to_y[i]
        least = self.record.min_margin
        if stops is None or (i not in stops and j not in stops):
            nearest = nearest_to_origin(rx, ry, end_x - rx, end_y - ry)
            if nearest < apart_m or self.record.open:
                self._look_at_piece(pair, step, 0.0, 1.0, rx, ry, end_x, end_y)
        else:
            nearest = inf
            stop_i, stop_j = stops.get(i, 1.0), stops.get(j, 1.0)
            was, was_x, was_y = 0.0, rx, ry
            for at in sorted({stop_i, stop_j, 1.0}):
                if at <= was:
                    continue
                part_i = min(at / stop_i, 1.0) if stop_i > 0.0 else 1.0
                part_j = min(at / stop_j, 1.0) if stop_j > 0.0 else 1.0
                now_x = rx + (to_x[j] - x[j]) * part_j - (to_x[i] - x[i]) * part_i
                now_y = ry + (to_y[j] - y[j]) * part_j - (to_y[i] - y[i]) * part_i
                nearest = min(nearest, nearest_to_origin(was_x, was_y, now_x - was_x, now_y - was_y))
                self._look_at_piece(pair, step, was, at, was_x, was_y, now_x, now_y)
                was, was_x, was_y = at, now_x, now_y
        margin = nearest - apart_m
        if margin < least["collision"]:
            least["collision"] = margin
        distance = sqrt(end_x * end_x + end_y * end_y)
        if self._touching and (i, j) in self._touching and distance > pair.contact_m + 2.0 * TOUCH_M:
            self._touching.discard((i, j))
            if distance >= apart_m:
                self.record.end("collision", (self._ids[i], self._ids[j]), (step + 1) * self._step_s)
        slack = max(distance - apart_m - max(least["collision"], 0.0), 0.0)
        pair.due = step + 1 + int(slack / (2.0 * self._reach_m))

    def _look_at_piece(
        self, pair: Pair, step: int, since: float, until: float, rx: float, ry: float, end_x: float, end_y: float
    ) -> None:
        """Record when, between two parts of a step, a pair comes into collision and out of it."""
        robots = (self._ids[pair.i], self._ids[pair.j])
        at_s, step_s = step * self._step_s, self._step_s
        inside = inside_disc(rx, ry, end_x - rx, end_y - ry, pair.apart_m)
        if inside is None:
            if (pair.i, pair.j) not in self._touching:
                self.record.end("collision", robots, at_s + since * step_s)
            return
        first, last = inside
        if first > 0.0 and (pair.i, pair.j) not in self._touching:
            self.record.end("collision", robots, at_s + since * step_s)
        self.record.begin("collision", robots, at_s + (since + first * (until - since)) * step_s)
        if last < 1.0 and (pair.i, pair.j) not in self._touching:
            self.record.end("collision", robots, at_s + (since + last * (until - since)) * step_s)

    # --- time 0 --------------------------------------------------------------------------------------------

    def _begin(self, bodies: Bodies) -> None:
        """Judge where the robots stand before anything moves."""
        x, y, least = bodies.x, bodies.y, self.record.min_margin
        for index in range(self._count):
            here_x, here_y = x[index], y[index]
            robots = (self._ids[index],)
            margin = self._fence.margin(here_x, here_y, here_x, here_y)
            least["geofence"] = min(least["geofence"], margin)
            if margin < -FENCE_TOLERANCE_M:
                self.record.begin("geofence", robots, 0.0)
            clear_m = self._clear[index]
            near = (
                min((self.boxes.point_to(here_x, here_y, box) for box in self.boxes.all), default=inf)
                - self._keep[index]
            )
            least["obstacle"] = min(least["obstacle"], near)
            if near + clear_m < -PENETRATION_M:
                self.hit_box(index, 0.0)
            if near < 0.0 < clear_m:
                self.record.begin("obstacle", robots, 0.0)
            self.on_charger[index] = any(point_to_box(here_x, here_y, patch) <= 0.0 for patch in self._chargers.all)
            least["battery"] = min(least["battery"], bodies.charge[index])
            if bodies.charge[index] <= 0.0 and not self.on_charger[index]:
                self.flat(index, 0.0)
            for other in range(index):
                distance = sqrt((x[other] - here_x) ** 2 + (y[other] - here_y) ** 2)
                contact_m = self._radius[other] + self._radius[index]
                apart_m = max(self._separation_m, contact_m)
                least["collision"] = min(least["collision"], distance - apart_m)
                if distance < apart_m:
                    self.record.begin("collision", (self._ids[other], self._ids[index]), 0.0)
                if distance < contact_m - PENETRATION_M:
                    self.hit_robot(other, index, 0.0)
        self._find_pairs(0, x, y)

"""Stops bodies where they touch, at exact times of impact along the chords of one step."""

from __future__ import annotations

from math import inf

from soter_sim.bodies import Bodies
from soter_sim.judge import Judge, Stops
from soter_sim.sweep import enter_disc


class Contacts:
    """Stops bodies that run into something between their places and where a step would take them.

    Args:
        judge: records contacts, and has the pairs that may touch.
        bodies: the bodies at the beginning of the step.
        to_x: where the step takes them, metres east; changed for those that are stopped.
        to_y: where the step takes them, metres north; changed likewise.
        step_s: duration of a step.
    """

    def __init__(self, judge: Judge, bodies: Bodies, to_x: list[float], to_y: list[float], step_s: float) -> None:
        self._judge = judge
        self._bodies = bodies
        self._to_x, self._to_y = to_x, to_y
        self._step_s = step_s

    def stop(self, step: int) -> Stops | None:
        """Stop every body that runs into something in this step, in order of time.

        Between two such events all bodies move along straight lines at constant speed, so each time of impact is
        exact. Of two robots that meet, each stops that moves towards the other.
        """
        judge = self._judge
        x, y, to_x, to_y = self._bodies.x, self._bodies.y, self._to_x, self._to_y
        radius = self._bodies.radius
        box_times: dict[int, float] = {}
        for i, due in enumerate(judge.box_due):
            if due <= step:
                dx, dy = to_x[i] - x[i], to_y[i] - y[i]
                if dx != 0.0 or dy != 0.0:
                    at = min(
                        (judge.boxes.meet(x[i], y[i], dx, dy, box, radius[i]) for box in judge.boxes.near(x[i], y[i])),
                        default=inf,
                    )
                    if at <= 1.0:
                        box_times[i] = at
        stops: Stops = {}
        meetings: dict[tuple[int, int], float] = {}
        for pair in judge.pairs:
            if pair.due <= step:
                at = self._meet(pair.i, pair.j, 0.0, stops)
                if at <= 1.0:
                    meetings[pair.i, pair.j] = at
        while box_times or meetings:
            box_hit = min(box_times, key=box_times.__getitem__, default=-1)
            pair_hit = min(meetings, key=meetings.__getitem__, default=(-1, -1))
            stopped: tuple[int, ...]
            box_at, pair_at = box_times.get(box_hit, inf), meetings.get(pair_hit, inf)
            if box_at <= pair_at:
                now, stopped = box_at, (box_hit,)
                self._judge.hit_box(box_hit, (step + now) * self._step_s)
            else:
                now, stopped = pair_at, self._who_stops(*pair_hit, pair_at, stops)
                self._judge.hit_robot(*pair_hit, (step + now) * self._step_s)
            for i in stopped:
                stops[i] = now
                self._bodies.v[i] = 0.0
                box_times.pop(i, None)
            # Only pairs with a body that was stopped now meet at another time.
            for pair in judge.pairs:
                if pair.due <= step and (pair.i in stopped or pair.j in stopped):
                    at = self._meet(pair.i, pair.j, now, stops)
                    if at <= 1.0:
                        meetings[pair.i, pair.j] = at
                    else:
                        meetings.pop((pair.i, pair.j), None)
        for i, at in stops.items():
            to_x[i] = x[i] + (to_x[i] - x[i]) * at
            to_y[i] = y[i] + (to_y[i] - y[i]) * at
        return stops or None

    def _apart(self, i: int, j: int, now: float, stops: Stops) -> tuple[float, float, float, float, float, float]:
        """Return the vector from i to j at a part of the step, and how far i and j would move in a whole step."""
        x, y, to_x, to_y = self._bodies.x, self._bodies.y, self._to_x, self._to_y
        at_i, at_j = stops.get(i, now), stops.get(j, now)
        ix, iy = to_x[i] - x[i], to_y[i] - y[i]
        jx, jy = to_x[j] - x[j], to_y[j] - y[j]
        rx = x[j] + jx * at_j - x[i] - ix * at_i
        ry = y[j] + jy * at_j - y[i] - iy * at_i
        if i in stops:
            ix = iy = 0.0
        if j in stops:
            jx = jy = 0.0
        return rx, ry, ix, iy, jx, jy

    def _meet(self, i: int, j: int, now: float, stops: Stops) -> float:
        """Return the part of the step, from `now` on, at which two robots meet; infinite if they do not."""
        rx, ry, ix, iy, jx, jy = self._apart(i, j, now, stops)
        radius = self._bodies.radius
        return now + enter_disc(rx, ry, jx - ix, jy - iy, radius[i] + radius[j])

    def _who_stops(self, i: int, j: int, now: float, stops: Stops) -> tuple[int, ...]:
        """Return which of two robots that meet move towards the other."""
        rx, ry, ix, iy, jx, jy = self._apart(i, j, now, stops)
        towards_j, towards_i = ix * rx + iy * ry, -(jx * rx + jy * ry)
        if towards_i > 0.0 and towards_j > 0.0:
            return i, j
        # At least one does; if rounding hides it, return the one that comes nearer to doing so.
        return (i,) if towards_j >= towards_i else (j,)

"""The engine without physics: acceleration-limited speeds, circular arcs, and exact contact along their chords.

In each step, of 0.05 s by default, the speeds change towards the command at constant rate, and the robot moves along
the circular arc with the length and turn that result. Bodies stop where they touch. They may turn in contact, and they
may move away again. A robot that pushes uses charge as if it drove.

One loop over plain floats serves few robots and many: each robot's command needs a call anyway, and the cost that would
grow with the square of the number of robots, the tests of pairs, is limited to the judge's short list. So a robot moves
in the same way, bit for bit, whichever other robots are far away.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin
from typing import Final

from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.bodies import Bodies
from soter_sim.contacts import Contacts
from soter_sim.judge import Judge

STEP_S: Final = 0.05
"""Default control period and integration step; 1/STEP_S is 20 Hz."""

_Constants = tuple[
    int, float, float, float, float, float, float, bool, float, float, float, float, float, float
]  # fmt: skip


class KinematicEngine:
    """Closed-form motion of differential-drive robots; implements `soter_sim.engine.Engine`.

    Args:
        workspace: fence, boxes and chargers.
        specs: the robots and where they start.
        limits: what the mission promises.
        step_s: control period and integration step.
    """

    def __init__(
        self,
        workspace: Workspace,
        specs: Sequence[RobotSpec],
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
        step_s: float = STEP_S,
    ) -> None:
        self.bodies = Bodies(specs)
        self.period_s = step_s
        fastest_m_s = max(each.v_max_m_s for each in self.bodies.limits)
        self._judge = Judge(workspace, self.bodies, step_s, fastest_m_s, limits)
        self.record = self._judge.record
        self._done = 0
        self._to_x = [*self.bodies.x]
        self._to_y = [*self.bodies.y]
        self._contacts = Contacts(self._judge, self.bodies, self._to_x, self._to_y, self.period_s)
        self._each: Final = tuple(_constants(self.bodies, index, step_s) for index in range(len(specs)))

    def run(self, until_period: int) -> None:
        judge, bodies, contacts = self._judge, self.bodies, self._contacts
        x, y, heading, v, yaw_rate = bodies.x, bodies.y, bodies.heading, bodies.v, bodies.yaw_rate
        charge, control, on_charger = bodies.charge, bodies.control, judge.on_charger
        to_x, to_y, carried = self._to_x, self._to_y, bodies.carried
        least_charge = self.record.min_margin["battery"]

        step_s = self.period_s
        half_s = 0.5 * step_s
        two_pi = 2.0 * pi

        for step in range(self._done, until_period):
            now_s = step * step_s
            for (
                i, v_max, w_max, dv_up, ramp_up, dv_down, ramp_down, uneven, dw_max, ramp_w, idle, busy_v, busy_w, gain,
            ) in self._each:  # fmt: skip
                v_is = v[i]
                w_is = yaw_rate[i]
                angle = heading[i]
                v_to, w_to = control[i](now_s, x[i], y[i], angle, v_is, w_is)
                left = charge[i]
                # Written so that NaN, too, is caught.
                if not -v_max <= v_to <= v_max:
                    v_to = v_max if v_to > v_max else -v_max if v_to < -v_max else 0.0
                if not -w_max <= w_to <= w_max:
                    w_to = w_max if w_to > w_max else -w_max if w_to < -w_max else 0.0
                if left <= 0.0:
                    v_to = w_to = 0.0

                change = v_to - v_is
                if change == 0.0:
                    length = v_is * step_s
                else:
                    if change * v_is >= 0.0:
                        dv_max, ramp_v = dv_up, ramp_up
                    else:
                        dv_max, ramp_v = dv_down, ramp_down
                        if uneven and v_to * v_is < 0.0:
                            # Stop at rest first: it brakes and speeds up at different rates.
                            v_to = 0.0
                            change = -v_is
                    if change > dv_max:
                        v[i] = v_to = v_is + dv_max
                        length = (v_is + v_to) * half_s
                    elif change < -dv_max:
                        v[i] = v_to = v_is - dv_max
                        length = (v_is + v_to) * half_s
                    else:
                        v[i] = v_to
                        length = v_to * step_s - change * (change if change > 0.0 else -change) * ramp_v
                change = w_to - w_is
                if change == 0.0:
                    turn = w_is * step_s
                elif change > dw_max:
                    yaw_rate[i] = w_to = w_is + dw_max
                    turn = (w_is + w_to) * half_s
                elif change < -dw_max:
                    yaw_rate[i] = w_to = w_is - dw_max
                    turn = (w_is + w_to) * half_s
                else:
                    yaw_rate[i] = w_to
                    turn = w_to * step_s - change * (change if change > 0.0 else -change) * ramp_w

                if turn == 0.0:
                    if length == 0.0:
                        to_x[i] = x[i]
                        to_y[i] = y[i]
                    else:
                        to_x[i] = x[i] + length * cos(angle)
                        to_y[i] = y[i] + length * sin(angle)
                else:
                    if length == 0.0:
                        to_x[i] = x[i]
                        to_y[i] = y[i]
                    else:
                        half = 0.5 * turn
                        # Half of the smallest float is 0.
                        chord = length * (sin(half) / half) if half != 0.0 else length
                        to_x[i] = x[i] + chord * cos(angle + half)
                        to_y[i] = y[i] + chord * sin(angle + half)
                    angle += turn
                    heading[i] = angle - two_pi if angle > pi else angle + two_pi if angle <= -pi else angle

                if on_charger[i] and length == 0.0 and turn == 0.0:
                    if left <= 0.0:
                        judge.charged(i, now_s)
                    left += gain
                    charge[i] = min(left, 1.0)
                elif left > 0.0:
                    use = (length if length > 0.0 else -length) * busy_v
                    use_turning = (turn if turn > 0.0 else -turn) * busy_w
                    if use_turning > use:
                        use = use_turning
                    use += idle
                    if left <= use:
                        if not on_charger[i]:
                            judge.flat(i, now_s + left / use * step_s)
                        charge[i] = left = 0.0
                    else:
                        charge[i] = left = left - use
                    if left < least_charge:
                        least_charge = left
                elif not on_charger[i]:
                    judge.flat(i, now_s)

            if carried:
                for i, (east, north) in carried.items():
                    to_x[i] += east * step_s
                    to_y[i] += north * step_s
            if step >= judge.due:
                judge.look(step, to_x, to_y, contacts.stop(step))
            x[:] = to_x
            y[:] = to_y
            self._done = step + 1
        self.record.min_margin["battery"] = least_charge

    def velocity(self, index: int) -> tuple[float, float]:
        speed, heading = self.bodies.v[index], self.bodies.heading[index]
        east, north = self.bodies.carried.get(index, (0.0, 0.0))
        return speed * cos(heading) + east, speed * sin(heading) + north

    def close(self) -> None:
        """Do nothing: there is nothing to free."""


def _constants(bodies: Bodies, i: int, step_s: float) -> _Constants:
    """Return a robot's constants: its index, its limits, and what motion costs.

    Limits are top speeds, and by how much speeds change in a step. While a speed changes by d at the rate a, the robot
    falls behind its new speed by d |d| / 2a.
    """
    own, idle_per_s = bodies.limits[i], bodies.idle_per_s[i]
    busy_per_s = bodies.drive_per_s[i] - idle_per_s
    return (
        i, own.v_max_m_s, own.yaw_rate_max_rad_s, own.accel_m_s2 * step_s, 0.5 / own.accel_m_s2,
        own.brake_m_s2 * step_s, 0.5 / own.brake_m_s2, own.brake_m_s2 != own.accel_m_s2,
        own.yaw_accel_rad_s2 * step_s, 0.5 / own.yaw_accel_rad_s2, idle_per_s * step_s, busy_per_s / own.v_max_m_s,
        busy_per_s / own.yaw_rate_max_rad_s, bodies.charge_per_s[i] * step_s,
    )  # fmt: skip

"""What really happened: violations as intervals, least margins, contacts.

The rules, as `soter_sim.judge` applies them:

- battery: the charge is 0 away from every charger.
- geofence: the centre is more than 1e-6 m beyond an edge of the fence.
- collision: two centres are nearer than the mission's separation, or two bodies overlap or are in contact.
- obstacle: the body is nearer to a box than the mission's clearance, or, if that is 0, reaches more than 1 mm into a
  box; or it is in contact with one.

Contact begins when a body is stopped by what it moves against, and ends when it is more than 2 mm away, or 4 mm from
another body. The mission's distances come as `soter.sdk.RuleLimits`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

from soter.sdk.values import RULES, TruthReport, Violation
from soter_sim.bodies import Bodies

FENCE_TOLERANCE_M: Final = 1e-6
PENETRATION_M: Final = 1e-3

# The PyBullet engine's rigid body tilts slightly and has facets, so it presses on things while its disc is still up to
# 1 mm away. Less than this would end a contact too early.
TOUCH_M: Final = 2e-3


@dataclass(slots=True)
class Record:
    """The judge's findings.

    Attributes:
        closed: violations that have ended.
        open: by rule and robots, when a present violation began.
        min_margin: by rule, the least margin so far.
        box_contacts: how often a robot began to touch a box.
        robot_contacts: how often two robots began to touch.
    """

    closed: list[Violation]
    open: dict[tuple[str, tuple[int, ...]], float]
    min_margin: dict[str, float]
    box_contacts: int = 0
    robot_contacts: int = 0

    def begin(self, rule: str, robots: tuple[int, ...], at_s: float) -> None:
        """Record that a rule is broken from now on; no change if it was already."""
        self.open.setdefault((rule, robots), at_s)

    def end(self, rule: str, robots: tuple[int, ...], at_s: float) -> None:
        """Record that a rule holds again; no change if it did already."""
        began_s = self.open.pop((rule, robots), None)
        if began_s is not None:
            self.closed.append(Violation(rule, robots, began_s, at_s))


class WorldTruth:
    """Ground truth of one world; implements `soter.sdk.Truth`.

    Args:
        record: the judge's findings.
        bodies: the world's robots.
    """

    def __init__(self, record: Record, bodies: Bodies) -> None:
        self._record = record
        self._bodies = bodies
        self._index = {robot_id: index for index, robot_id in enumerate(bodies.ids)}

    def report(self) -> TruthReport:
        """Return what has happened up to now; a present violation has no end."""
        record = self._record
        violations = [*record.closed]
        violations += [Violation(rule, robots, at_s, None) for (rule, robots), at_s in record.open.items()]
        violations.sort(key=lambda each: (each.start_s, RULES.index(each.rule), each.robots))
        margins = {rule: record.min_margin[rule] for rule in RULES if record.min_margin[rule] < inf}
        contacts = record.box_contacts + record.robot_contacts
        charges = dict(zip(self._bodies.ids, self._bodies.charge, strict=True))
        return TruthReport(tuple(violations), margins, contacts, charges=charges)

    @property
    def robot_contacts(self) -> int:
        """Number of the report's contacts that were between two robots."""
        return self._record.robot_contacts

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is: x_m, y_m, heading_rad."""
        bodies = self._bodies
        index = self._index[robot_id]
        return bodies.x[index], bodies.y[index], bodies.heading[index]

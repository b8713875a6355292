"""Ground truth of all rules: the world's judgement of its own, and that of the rules of a user's own modules."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from soter.check.user_rules import UserRules
from soter.rta import RobotSupervisor
from soter.sdk import RULES, Truth, TruthReport

logger = logging.getLogger(__name__)


class WholeTruth:
    """Joins what the world says with the judgement of users' rules; implements `soter.sdk.Truth`.

    Args:
        truth: the world's ground truth.
        own: judges the users' rules by it.

    Attributes:
        rules: the names of all rules.
        judges_own_rules: whether there are any of the user's own; if not, `look` does nothing.
    """

    def __init__(self, truth: Truth, own: UserRules) -> None:
        self._truth: Final = truth
        self._own: Final = own
        self.rules: Final = (*RULES, *own.names)
        self.judges_own_rules: Final = bool(own.names)
        self._no_number: Final[dict[str, float]] = {}

    def look(self, now_s: float, robots: Iterable[RobotSupervisor]) -> None:
        """Judge the users' rules over the time since the last look; see `UserRules.look`."""
        self._own.look(now_s, robots)
        for (robot_id, name), margin in self._own.margin.items():
            if math.isnan(margin) and name not in self._no_number:
                self._no_number[name] = math.nan
                text = "the margin of '%s' is not a number, first of robot %d at %.2f s; that counts as a violation"
                logger.error(text, name, robot_id, now_s)

    def report(self) -> TruthReport:
        """Return what has happened up to now; a margin that ever was not a number has no least one, but NaN."""
        report, own = self._truth.report(), self._own
        if not own.names:
            return report
        violations = sorted((*report.violations, *own.violations()), key=lambda each: each.start_s)
        margins = {**report.min_margin, **own.min_margin, **self._no_number}
        return replace(report, violations=tuple(violations), min_margin=margins)

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is: x_m, y_m, heading_rad."""
        return self._truth.pose(robot_id)

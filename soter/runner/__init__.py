"""Runs a mission: mission in, result out.

Its names are loaded when they are first used: a mission in a process of its own starts without what judges the run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.lazy import lazily

if TYPE_CHECKING:
    from soter.runner.progress import Follower, Progress, RobotProgress
    from soter.runner.result import Run, RunResult, TickTimes
    from soter.runner.run import run_mission
    from soter.stack.assembly import Study
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "soter.runner.progress": ("Follower", "Progress", "RobotProgress"),
            "soter.runner.result": ("Run", "RunResult", "TickTimes"),
            "soter.runner.run": ("run_mission",),
            "soter.stack.assembly": ("Study",),
        },
    )

__all__ = [
    "Follower",
    "Progress",
    "RobotProgress",
    "Run",
    "RunResult",
    "Study",
    "TickTimes",
    "run_mission",
]

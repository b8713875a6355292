"""Runs a mission: mission in, result out."""

from soter.runner.progress import Follower, Progress, RobotProgress
from soter.runner.result import Run, RunResult, TickTimes
from soter.runner.run import run_mission
from soter.stack.assembly import Study

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

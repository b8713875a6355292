"""Mission in, result out."""

from soter.runner.progress import Progress, RobotProgress
from soter.runner.result import Run, RunResult, TargetCounts, TickTimes
from soter.runner.run import Study, run_mission

__all__ = [
    "Progress",
    "RobotProgress",
    "Run",
    "RunResult",
    "Study",
    "TargetCounts",
    "TickTimes",
    "run_mission",
]

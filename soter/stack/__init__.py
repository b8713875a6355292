"""The stack: the mission's machines on one side of the ports, safety modules and safe controllers on the other.

Nothing is imported here, so that a planner's worker process, which needs the planners only, starts faster.
"""

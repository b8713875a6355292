"""The stack: the mission's machines on one side of the ports, safety modules and safe controllers on the other.

Nothing is imported here: a planner's worker process needs the planners only, and starts the faster for it.
"""

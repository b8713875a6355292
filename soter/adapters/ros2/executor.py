"""The executor that this package's nodes run in."""

from __future__ import annotations

import faulthandler

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor


def executor_in(context: Context) -> Executor:
    """Return an executor, rclpy's events executor where it has one: that takes about half of the processor time.

    Spin it with a time-out; without one, the events executor may spin without a pause.
    """
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    was_enabled = faulthandler.is_enabled()
    executor = EventsExecutor(context=context)
    # It switches this on for the whole process, which is not ours alone.
    if not was_enabled:
        faulthandler.disable()
    return executor

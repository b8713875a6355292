"""The nodes of this package, and the executor that they run in."""

from __future__ import annotations

import faulthandler
import logging
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

logger = logging.getLogger(__name__)

_AWAKE_S: Final = 0.5


class GuardedNode(Node):
    """A node that goes on when a callback fails: what that was called for is dropped.

    The events executor prints each failure of a callback, and a robot may send what cannot be taken at 50 Hz.

    Attributes:
        failed: how many calls have failed. The first is logged.
    """

    failed = 0

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[[Any], None], qos_profile: QoSProfile | int, **options: Any
    ) -> object:
        return super().create_subscription(msg_type, topic, partial(self._guarded, callback), qos_profile, **options)

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], None], *, clock: Clock | None = None, **options: Any
    ) -> object:
        return super().create_timer(timer_period_sec, partial(self._guarded, callback), clock=clock, **options)

    def _guarded(self, callback: Callable[..., None], *given: Any) -> None:
        try:
            callback(*given)
        except Exception as failure:
            self.failed += 1
            if self.failed == 1:
                logger.warning("dropped a message that could not be taken", exc_info=failure)


def executor_in(context: Context) -> Executor:
    """Return an executor, rclpy's events executor where it has one: that takes about half of the processor time."""
    was_enabled = faulthandler.is_enabled()
    try:
        from rclpy.experimental import EventsExecutor

        executor = EventsExecutor(context=context)
    except (ImportError, OSError, RuntimeError, AttributeError):
        # An older rclpy; or standard error is no file, as in a notebook, and its fault handler can print nowhere.
        return SingleThreadedExecutor(context=context)
    # It switches the fault handler on for the whole process, which is not ours alone.
    if not was_enabled:
        faulthandler.disable()
    return executor


def spin(executor: Executor, ended: Callable[[], bool]) -> None:
    """Run what is due in an executor until it has ended, or rclpy is shut down; the first failure is logged."""
    failed = False
    while not ended():
        try:
            # Without a time-out the events executor does not pause.
            executor.spin_once(_AWAKE_S)
        except ExternalShutdownException:
            return
        except Exception:
            if not failed:
                failed = True
                logger.exception("rclpy failed, and is asked again")

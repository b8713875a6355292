from enum import Enum

from rclpy.time import Time

class ClockType(Enum):
    STEADY_TIME = ...

class Clock:
    def __init__(self, *, clock_type: ClockType = ...) -> None: ...
    def now(self) -> Time: ...

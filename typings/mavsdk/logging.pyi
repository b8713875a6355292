from collections.abc import Callable
from enum import IntEnum

class LogLevel(IntEnum):
    DEBUG = 0
    INFO = 1
    WARN = 2
    ERROR = 3

def log_subscribe(callback: Callable[[LogLevel, str, str | None, int], bool]) -> None: ...

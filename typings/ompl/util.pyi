"""Logging and random numbers."""

import enum

class LogLevel(enum.Enum):
    LOG_DEV2 = -2
    LOG_DEV1 = -1
    LOG_DEBUG = 0
    LOG_INFO = 1
    LOG_WARN = 2
    LOG_ERROR = 3
    LOG_NONE = 4

LOG_DEBUG: LogLevel
LOG_INFO: LogLevel
LOG_WARN: LogLevel
LOG_ERROR: LogLevel
LOG_NONE: LogLevel

def setLogLevel(level: LogLevel) -> None: ...
def getLogLevel() -> LogLevel: ...

class RNG:
    @staticmethod
    def getSeed() -> int: ...
    @staticmethod
    def setSeed(seed: int) -> None: ...

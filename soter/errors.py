"""The error tree of SOTER: whatever goes wrong by design is a `SoterError`.

```
SoterError
|- ConfigError            a file, key or number that is not allowed
|- BackendError
|  |- UnknownBackend      no backend of that name
|  |- BackendUnavailable  its library is not installed
|  |- RobotUnavailable    no such robot there, it does not answer, or it refuses to get ready
|  |- Intruder            somebody else moves the robot
|  |- Uncontrolled        the robot does not do what it is told
|  |- LifecycleError      a call before init() or after close()
|  `- Unsupported         the robot cannot do that and says so
|- IllFormedModule        a safety module whose proof obligations do not hold
|- MachineError           see soter.machine
`- RunFailed              a run that had to end early
```
"""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Final

_SOTER: Final = str(Path(__file__).parent) + os.sep


class SoterError(Exception):
    """Root of everything that SOTER raises on purpose."""


class Garbage(ValueError):
    """What came from untrusted code, or from another process, is not what was agreed."""


class ConfigError(SoterError):
    """Bad input, found before anything moves.

    Args:
        message: what is wrong, what is allowed and, for a misspelt name, the nearest valid one.
        source: the file, or None for input that came from elsewhere.
        line: the line in that file, or None.
        key: the dotted key or the element, or None.
    """

    def __init__(
        self, message: str, *, source: str | None = None, line: int | None = None, key: str | None = None
    ) -> None:
        self.source, self.line, self.key = source, line, key
        place = source or ""
        if line is not None:
            place += f":{line}"
        parts = [part for part in (place, key, message) if part]
        super().__init__(": ".join(parts))


def option_error(option: str, message: str) -> ConfigError:
    """Return the error of an option of the command line."""
    return ConfigError(message, source="command line", key=option)


class BackendError(SoterError):
    """A backend or one of its robots cannot do what was asked."""


class UnknownBackend(BackendError):
    """No backend is registered under that name."""


class BackendUnavailable(BackendError):
    """The backend exists, but a library that it needs is missing; the message says what to install."""


class RobotUnavailable(BackendError):
    """The robot is not there, does not answer in time, or refuses to get ready."""


class Intruder(BackendError):
    """Another program moves the robot, past its supervisor; the message says where that was seen.

    Recordings keep what a failure looks like, and so it is known by that.
    """

    MARK = "intruder: "

    def __repr__(self) -> str:
        return f"{self.MARK}{self}"


class Uncontrolled(BackendError):
    """The robot does not do what it is told, such as one that its pilot has taken; the message says what it does.

    It is known by its looks, likewise.
    """

    MARK = "not under control: "

    def __repr__(self) -> str:
        return f"{self.MARK}{self}"


class LifecycleError(BackendError):
    """A robot was used before `init()` or after `close()`."""


class Unsupported(BackendError):
    """The robot lacks a capability; it says so instead of doing nothing."""


class IllFormedModule(SoterError):
    """A safety module for which the promise cannot be made; the message names the condition and the numbers.

    Args:
        module: the module's name.
        condition: the condition that fails, such as "P3".
        message: the numbers, and a value that would do.
        would_do: that value, by the key of the module's table that it is for, where one key is enough.
        remedy: that value in a few words, such as "Delta = 0.1 s"; empty where only the message says it.

    Attributes:
        why: the message alone.
    """

    def __init__(
        self, module: str, condition: str, message: str, would_do: dict[str, float] | None = None, remedy: str = ""
    ) -> None:
        self.module, self.condition, self.why = module, condition, message
        self.would_do, self.remedy = would_do or {}, remedy
        super().__init__(f"module '{module}' is ill-formed ({condition}): {message}")

    def named(self, module: str) -> IllFormedModule:
        """Return the same failure under the name that a module has in its mission."""
        return type(self)(module, self.condition, self.why, self.would_do, self.remedy)


class RunFailed(SoterError):
    """A run ended early; its robots are stopped and its recording is closed."""


MAX_WORDS = 1000
"""The longest account of a failure, in characters."""


def account_of(failure: BaseException, shown: Callable[[BaseException], str] = repr) -> str:
    """Return what a failure looks like, in one line that is not too long, whatever foreign code has made of it.

    Args:
        failure: the failure.
        shown: how it is shown, such as by `str`.
    """
    try:
        text = str.encode(shown(failure), errors="backslashreplace").decode()
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - foreign code wrote what shows it
        text = "a failure that cannot say what it is"
    return " ".join(text[:MAX_WORDS].split())


def is_interruption(failure: BaseException) -> bool:
    """Return whether foreign code was interrupted, as by Ctrl-C, and has not failed by itself.

    Where Ctrl-C is ignored, as in a mission's own process, only the code itself can have raised a KeyboardInterrupt.
    Subclasses are those of a watchdog, which uses another signal.
    """
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    return isinstance(failure, KeyboardInterrupt) and not (ignored and type(failure) is KeyboardInterrupt)


def raised_at(failure: BaseException) -> str:
    """Return file and line of foreign code that an exception was raised in, as the end of a message; empty without.

    What foreign code has called, in SOTER and in libraries, is passed over.
    """
    import sysconfig

    python, *installed = (sysconfig.get_path(each) + os.sep for each in ("stdlib", "purelib", "platlib"))
    found: dict[bool, str] = {}
    at = failure.__traceback__
    while at is not None:
        file = at.tb_frame.f_code.co_filename
        added = file.startswith(tuple(installed))
        if added or not file.startswith(("<", _SOTER, python)):
            found[added] = f" ({Path(file).name}, line {at.tb_lineno})"
        at = at.tb_next
    return found.get(False, found.get(True, ""))


def floor_m(value: float) -> str:
    """Return a length that falls short as a message shows it: rounded down, so that it is seen to fall short."""
    return f"{math.floor(value * 1000.0 + 1e-6) / 1000.0:.3f}"


def ceil_m(value: float) -> str:
    """Return a length that would do as a message shows it: rounded up, so that what is copied from it does."""
    return f"{math.ceil(value * 1000.0 - 1e-6) / 1000.0:.3f}"


def nearest(name: str, allowed: list[str]) -> str:
    """Return ", did you mean 'x'?" for a misspelt name, else an empty string."""
    import difflib

    close = difflib.get_close_matches(name, allowed, n=1)
    return f", did you mean '{close[0]}'?" if close else ""


def meant(path: Path) -> str:
    """Return ", did you mean 'x'?" for a file that is not there where one like it is, else an empty string."""
    try:
        return nearest(path.name, sorted(other.name for other in path.parent.iterdir() if other.suffix == path.suffix))
    except OSError:
        return ""

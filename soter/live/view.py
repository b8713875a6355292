"""The run's side of a live view: starts the process that shows the run, and sends it the recording's path.

The run does nothing else. The process reads the growing recording, so that a view cannot delay a tick, whatever happens
to the process and its viewers.
"""

from __future__ import annotations

import logging
import os
import select
import threading
from pathlib import Path
from typing import Final, NamedTuple, Self

from soter.errors import ConfigError, option_error
from soter.isolation.child import Child, ChildDied

logger = logging.getLogger(__name__)

HOST: Final = "127.0.0.1"
READY_S: Final = 20.0
"""Host time that the process is given to start, with its imports."""

CLOSE_S: Final = 30.0
"""Host time that the process is given at the end, to read the rest and to show viewers how the run ended."""

READY: Final = b"ready "
FAILED: Final = b"failed "


class Kind(NamedTuple):
    """One kind of live view.

    Attributes:
        screen: the class that shows a run in a process of its own, a `soter.live.process.Screen`, as `module:Class`.
        name: its name in messages.
        option: the command-line option for its port, for messages.
        address: its address, with {port} in it.
    """

    screen: str
    name: str
    option: str
    address: str


PAGE: Final = Kind("soter.live.web:PageScreen", "the live page", "--live-port", "http://127.0.0.1:{port}/")
APP: Final = Kind(
    "soter.live.app:AppScreen", "the server for the Foxglove app", "--foxglove-port", "ws://127.0.0.1:{port}"
)


class LiveView:
    """A process that shows a run. A context manager; at its end viewers see how the run ended.

    Used from one thread. If the process ends before the run does, that is logged once, and the run goes on.

    Args:
        kind: the kind of view.
        port: a port of 127.0.0.1; 0 for a free one.

    Raises:
        ConfigError: the port is not available, or the process does not start.
    """

    def __init__(self, kind: Kind, port: int = 0) -> None:
        self._kind: Final = kind
        self._child: Final = Child("soter.live.process", (kind.screen, port))
        try:
            said = self._child.receive(READY_S)
            if said is None or not said.startswith(READY):
                why = f"its process is not ready after {READY_S:g} s" if said is None else reason(said)
                taken = f"port {port} of {HOST} cannot be had: {why}; name another"
                raise self._refusal(taken if port and said else why)
        except BaseException as failure:
            self._child.kill()
            if isinstance(failure, ChildDied):
                raise self._refusal(f"its process has ended: {failure}") from failure
            raise
        self.address: Final = kind.address.format(port=int(said[len(READY) :]))
        self._wake, self._woken = os.pipe()
        self._watcher: Final = threading.Thread(target=self._watch, name=f"watch {kind.screen}", daemon=True)
        self._watcher.start()

    @property
    def gone(self) -> bool:
        """Whether the process has ended."""
        return not self._watcher.is_alive()

    @property
    def pid(self) -> int:
        """The process's id."""
        return self._child.pid

    def begin(self, path: Path) -> None:
        """Show a recording whose head is already written."""
        try:
            self._child.send(os.fsencode(path.absolute()))
        except ChildDied:
            # The process has ended, which `_watch` logs.
            return

    def close(self) -> None:
        """Let the process end by itself, for at most `CLOSE_S`; then kill it. Idempotent."""
        if self._watcher.is_alive():
            os.write(self._woken, b"\n")
            self._watcher.join()
        self._child.kill(grace_s=CLOSE_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
        for fd in (self._wake, self._woken):
            os.close(fd)

    def _watch(self) -> None:
        """Wait in a thread, and log if the process ends too early."""
        process = os.pidfd_open(self._child.pid)
        try:
            poll = select.poll()
            poll.register(process, select.POLLIN)
            poll.register(self._wake, select.POLLIN)
            ready = {fd for fd, _ in poll.poll()}
        finally:
            os.close(process)
        if self._wake in ready:
            return
        try:
            said = self._child.receive()
        except ChildDied as failure:
            if self._child.how_it_ended() == "exit code 0":  # the recording has come to its end
                return
            said = FAILED + str(failure).encode()
        logger.warning("%s has ended: %s; the run goes on", self._kind.name, reason(said or b""))

    def _refusal(self, why: str) -> ConfigError:
        return option_error(self._kind.option, f"{self._kind.name}: {why}")


def reason(said: bytes) -> str:
    """Return the failure that a process reported, in words."""
    return said.removeprefix(FAILED).decode(errors="replace") or "it did not say why"

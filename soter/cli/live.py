"""The live views of `soter run`, and the pace of virtual time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Final

from soter.cli.exits import StopSignals
from soter.errors import option_error
from soter.scratch import Scratch

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console

    from soter.config import MissionFile
    from soter.live.view import LiveView

APP_PORT: Final = 8765
"""The default port of the Foxglove app."""

_SLICE_S: Final = 0.05
"""Longest host time until Ctrl-C is noticed while a tick waits."""


class Views:
    """The requested views of a run: the live page, and the server for the Foxglove app.

    Without a port, the page takes a free one, and the server `APP_PORT`. `opened` opens the page in a browser, and
    `leave` closes it when the run has ended.

    Raises:
        ConfigError: an option belongs to a view that was not requested, or a library is missing.
    """

    def __init__(
        self, live: bool, live_port: int | None, foxglove: bool, foxglove_port: int | None, opened: bool, leave: bool
    ) -> None:
        from soter.live.view import APP, PAGE

        for given, wanted, view, option in (
            (live_port is not None, live, "--live", "--live-port"),
            (opened, live, "--live", "--open"),
            (leave, live, "--live", "--leave"),
            (foxglove_port is not None, foxglove, "--foxglove", "--foxglove-port"),
        ):
            if given and not wanted:
                raise option_error(option, f"it says how, but not what: add {view}")
        if foxglove:
            _require_sdk()
        self._wanted: Final = [(PAGE, live_port or 0)] if live else []
        if foxglove:
            self._wanted.append((APP, APP_PORT if foxglove_port is None else foxglove_port))
        self._opened: Final = opened
        self._stays: Final = live and not leave
        self._started: list[LiveView] = []
        self._console: Console

    @contextmanager
    def shown(self, recording: Path | None, console: Console) -> Iterator[Path | None]:
        """Start the views, and print their addresses.

        Args:
            recording: the file that the run is recorded in, or None. Views show a recording: without one, they need
                one in a temporary folder.
            console: for the addresses.

        Yields:
            The file to record the run in, or None.

        Raises:
            ConfigError: a port is not available.
        """
        from soter.live.view import LiveView

        with ExitStack() as stack:
            if recording is None and self._wanted:
                scratch = Scratch("live")
                stack.callback(scratch.close)
                recording = scratch.path / "run.mcap"
            self._started = [stack.enter_context(LiveView(kind, port)) for kind, port in self._wanted]
            for (kind, _), view in zip(self._wanted, self._started, strict=True):
                console.print(f"{kind.name}: {view.address}", soft_wrap=True)
            self._console = console
            yield recording

    def begin(self, path: Path) -> None:
        """Show a recording whose head is already written, as that of a mission that is accepted."""
        for view in self._started:
            view.begin(path)
        if self._opened:
            # Some browsers are waited for, and robots are not to wait.
            threading.Thread(target=_open, args=(self._started[0].address, self._console), daemon=True).start()

    def stay(self, console: Console) -> None:
        """Keep the live page after the run's end until Ctrl-C, unless it is to be closed."""
        if self._stays and not self._started[0].gone:
            console.print(f"the page stays until Ctrl-C: {self._started[0].address}", soft_wrap=True)
            _wait(self._started[0])


def _open(address: str, console: Console) -> None:
    import webbrowser

    if not webbrowser.open(address):
        console.print("no browser could be opened; open the address yourself", soft_wrap=True)


def _wait(view: LiveView) -> None:
    """Wait for Ctrl-C, or for the view's end."""
    pause = threading.Event()
    with StopSignals() as stop, suppress(KeyboardInterrupt), stop.raising():
        while not view.gone:
            pause.wait(1.0)


def pace_of(times: float | None, mission: MissionFile, stop: Callable[[], bool]) -> Callable[[float], None] | None:
    """Return a function that holds a run to `times` the speed of the clock, until stopped; None for no limit.

    Raises:
        ConfigError: the robots have a clock of their own.
    """
    if times is None:
        return None
    from soter.registry import in_virtual_time

    if not in_virtual_time(mission.backend):
        raise option_error(
            "--pace", f"robots of '{mission.backend}' keep to the clock as they are; allowed with those in virtual time"
        )
    zero_s: float | None = None

    def hold(time_s: float) -> None:
        """Let no tick begin early. Delays of a slow host are not made up for."""
        nonlocal zero_s
        now_s = time.monotonic()
        due_s = now_s if zero_s is None else zero_s + time_s / times
        if due_s <= now_s:
            zero_s = now_s - time_s / times
            return
        while (left_s := due_s - time.monotonic()) > 0.0 and not stop():
            time.sleep(min(left_s, _SLICE_S))

    return hold


def _require_sdk() -> None:
    from importlib.util import find_spec

    from soter.registry import install_hint

    if find_spec("foxglove") is None:
        raise option_error(
            "--foxglove", f"it needs foxglove-sdk, which is not installed; install it with: {install_hint('foxglove')}"
        )

"""How `soter run` shows a run while it goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Final

from soter.errors import ConfigError
from soter.scratch import Scratch

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console

    from soter.live.view import Kind

APP_PORT: Final = 8765
"""Where the Foxglove app looks if nobody tells it otherwise."""


def wanted_views(
    live: bool, live_port: int | None, foxglove: bool, foxglove_port: int | None
) -> list[tuple[Kind, int]]:
    """Return the views that were asked for, each with its port.

    Raises:
        ConfigError: a port was named for a view that was not asked for, or a library is missing.
    """
    from soter.live.view import APP, PAGE

    for port, wanted, option in ((live_port, live, "--live"), (foxglove_port, foxglove, "--foxglove")):
        if port is not None and not wanted:
            raise ConfigError(f"it says where, but not that: add {option}", source="command line", key=f"{option}-port")
    if foxglove:
        _require_sdk()
    views = [(PAGE, live_port or 0)] if live else []
    return [*views, (APP, APP_PORT if foxglove_port is None else foxglove_port)] if foxglove else views


@contextmanager
def shown(
    views: Sequence[tuple[Kind, int]], recording: Path | None, console: Console
) -> Iterator[tuple[Path | None, Callable[[Path], None] | None]]:
    """Start views of a run, and say where they are.

    Args:
        views: see `wanted_views`.
        recording: where the run is recorded, or None. Views show what is recorded: a run that leaves no recording has
            one all the same while they are wanted, in a temporary folder.
        console: for the addresses.

    Yields:
        Where to record, and what to call once there is a recording.

    Raises:
        ConfigError: a port cannot be had.
    """
    if not views:
        yield recording, None
        return
    from soter.live.view import LiveView

    with ExitStack() as stack:
        if recording is None:
            scratch = Scratch("live")
            stack.callback(scratch.close)
            recording = scratch.path / "run.mcap"
        started = [stack.enter_context(LiveView(kind, port)) for kind, port in views]
        for (kind, _), view in zip(views, started, strict=True):
            console.print(f"{kind.name}: {view.address}", soft_wrap=True)

        def begin(path: Path) -> None:
            for view in started:
                view.begin(path)

        yield recording, begin


def _require_sdk() -> None:
    from importlib.util import find_spec

    from soter.registry import install_hint

    if find_spec("foxglove") is None:
        raise ConfigError(
            f"it needs foxglove-sdk, which is not installed; install it with: {install_hint('foxglove')}",
            source="command line",
            key="--foxglove",
        )

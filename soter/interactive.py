"""A run from a script or a notebook in one call: figures, recording, data frames, a picture and the page.

It stands above the runner, the recordings and the report, and does nothing that they do not do for the command line.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterator, Mapping
from contextlib import closing
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from soter.config import load_mission
from soter.errors import ConfigError, SoterError
from soter.loading import seen_from
from soter.missions import ROOM
from soter.problems import split_key
from soter.record.export import export_csv
from soter.record.reader import Recording
from soter.registry import install_hint
from soter.report.caption import Caption, Rule
from soter.report.page.html import make_page
from soter.runner import RunResult, run_mission
from soter.scratch import Scratch

if TYPE_CHECKING:
    import pandas as pd

ARGUMENT: Final = "argument"
SETTINGS: Final = "settings"
KEYWORD: Final = "keyword argument"
"""Where a value came from, for messages."""

PAGE_HEIGHT_PX: Final = 820
"""How much of a notebook the page of a run takes."""


class FinishedRun:
    """A run that is over. A notebook shows it as the page that plays it; `draw` and `write_page` make files.

    Args:
        result: its figures.
        recording: what was run, known, decided and done.
        scratch: where the recording is, which goes when this goes, or None.
    """

    def __init__(self, result: RunResult, recording: Recording, scratch: Scratch | None = None) -> None:
        self.result: Final = result
        self.recording: Final = recording
        if scratch is not None:
            weakref.finalize(self, scratch.close)

    @classmethod
    def read(cls, path: Path | str) -> Self:
        """Return the run of a recording, such as one that `soter run` has made.

        Raises:
            ConfigError: it is no recording, it is damaged, or its run did not come to an end.
        """
        recording = Recording(Path(path))
        if (result := recording.result_json) is None:
            raise ConfigError("it has no result: its run did not come to an end", source=str(path))
        return cls(RunResult.model_validate_json(result), recording)

    @property
    def ok(self) -> bool:
        """Whether the run completed, broke no rule, and every robot kept its AC and was under control.

        If not, `result.status`, `failure`, `violations`, `failed_robots` and `uncontrolled` say why.
        """
        result = self.result
        troubled = result.violated or result.failed_robots or result.uncontrolled
        return result.status == "completed" and not troubled

    @cached_property
    def frames(self) -> Mapping[str, pd.DataFrame]:
        """The recording as data frames, by kind.

        `ticks` has a row a robot and tick, `modules` one a module, robot and tick, with margin and reach bound; the
        others, such as `switch` and `violation`, one an event. Times are fleet time in seconds. docs/notebook.md has
        the keys.

        Raises:
            SoterError: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError as failure:
            raise SoterError(f"data frames need pandas; install it with: {install_hint('pandas')}") from failure
        with closing(Scratch("frames")) as scratch:
            return {path.stem: pd.read_csv(path) for path in export_csv(self.recording, scratch.path / "csv")}

    def draw(self, path: Path | str) -> None:
        """Draw the run into a PNG file, which is replaced.

        Raises:
            SoterError: matplotlib is not installed.
        """
        Path(path).write_bytes(self._repr_png_())

    def write_page(self, path: Path | str) -> None:
        """Write the page that plays the run in any browser, without a network; a file that is there is replaced."""
        Path(path).write_text(make_page(self.recording), encoding="utf-8")

    def __repr__(self) -> str:
        figures = ", ".join(_caption(self.result).figures)
        return f"<{type(self).__name__} {self.result.status}: {figures}>"

    def _repr_html_(self) -> str:
        """The page, in a frame of its own: its styles and its programs stay there."""
        page = escape(make_page(self.recording))
        size = f"width: 100%; height: {PAGE_HEIGHT_PX}px; border: 0"
        return f'<iframe sandbox="allow-scripts" style="{size}" srcdoc="{page}"></iframe>'

    def _repr_png_(self) -> bytes:
        """The picture of the run, for what shows no pages."""
        try:
            from soter.report.picture import draw_png
        except ImportError as failure:
            hint = install_hint("matplotlib")
            raise SoterError(f"pictures are drawn with matplotlib; install it with: {hint}") from failure
        return draw_png(self.recording.tracks(), _caption(self.result))


def run(
    mission: Path | str,
    settings: Mapping[str, Any] | None = None,
    *,
    record: Path | str | None = None,
    force: bool = False,
    accept_unproved: bool = False,
    **keys: Any,
) -> FinishedRun:
    """Run a mission to its end and return all that is known of it; call it from the main thread.

    Args:
        mission: a mission file, or a script `FILE.py`, which is run in a room of 5 m with two robots.
        settings: values that take the place of the mission file's, by dotted key: `{"rta.collision.delta_s": 0.1}`. A
            table, `{"rta": {"collision": {"delta_s": 0.1}}}`, says the same: keys that it does not have stay.
        record: where the recording stays, a new file; without it it is gone with what is returned.
        force: whether a recording that is there already is replaced.
        accept_unproved: whether to run what is not proved; the result says what that was.
        **keys: settings of the mission file's first level, such as `seed=3`, `duration_s=60.0`, `backend="kinematic"`.

    Raises:
        ConfigError: bad input, a recording that is there already, or a module that is not proved; nothing has moved.
        BackendError: the backend cannot be opened or a robot does not get ready; nothing has moved.
        IllFormedModule: a safety module cannot keep its promise on these robots; nothing has moved.
        SoterError: the run could not be recorded.
    """
    overrides: dict[str, object] = {}
    origins: dict[str, str] = {}
    known: set[tuple[str, ...]] = set()
    for origin, given in ((SETTINGS, settings or {}), (KEYWORD, keys)):
        for key, value in _by_dotted_key(given):
            if (parts := split_key(key)) in known:
                raise ConfigError("it is given twice", key=".".join(parts))
            known.add(parts)
            overrides[key], origins[key] = value, origin
    if Path(mission).suffix == ".py":
        overrides["mission"], origins["mission"] = seen_from(Path.cwd(), str(mission)), ARGUMENT
        mission = ROOM
    loaded = load_mission(mission, overrides, origins=origins)
    scratch = None
    if record is None:
        scratch = Scratch("run")
        path = scratch.path / "run.mcap"
    elif (path := Path(record)).exists():
        if not force:
            said = f"'{path}' is there already; name another file, or give force=True to replace it"
            raise ConfigError(said, source=KEYWORD, key="record")
        Recording(path)  # what is no recording is not replaced by one
    try:
        done = run_mission(loaded, record=path, accept_unproved=accept_unproved)
        if done.recording is None or done.recording.failure:
            why = done.recording.failure if done.recording else "nothing moved"
            raise SoterError(f"the run was not recorded: {why}")
        return FinishedRun(done.result, Recording(path), scratch)
    except BaseException:
        if scratch is not None:
            scratch.close()
        raise


def _by_dotted_key(given: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    """Yield the values of settings by dotted key; those of a table have its key before their own."""
    for key, value in given.items():
        if isinstance(value, Mapping):
            # The name of a backend may have dots.
            yield from _by_dotted_key({f'{key}."{name}"': each for name, each in value.items()})
        else:
            yield key, value


def _caption(result: RunResult) -> Caption:
    """The words of the picture: what was run, and the figures that matter most."""
    broken = None if result.violations is None else sum(result.violations.values())
    return Caption(
        title=f"{Path(result.mission).stem}: {result.robots} robots, {result.duration_s:.0f} s on {result.backend}",
        figures=(
            f"AC in control {100.0 * result.ac_share:.1f} %",
            f"{result.disengagements_total} disengagements",
            "violations unknown" if broken is None else f"{broken} violations",
        ),
        alarming=result.violated,
        details=f"seed {result.seed}",
        disengagements=dict(result.disengagements),
        rules=tuple(
            Rule(name, f"{count} ×", _margin_text(margin), broken=count > 0)
            for name, count in (result.violations or {}).items()
            for margin in [(result.min_margin or {}).get(name, math.inf)]
        ),
    )


def _margin_text(margin: float) -> str:
    if math.isnan(margin):
        return "NaN"
    return "-" if margin == math.inf else f"{margin:.3f}"

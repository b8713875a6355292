"""One run of a campaign: its settings, the command that repeats it, and its outcome."""

from __future__ import annotations

import faulthandler
import hashlib
import json
import logging
import math
import os
import shlex
import signal
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from multiprocessing import parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from soter.config import MissionFile, load_mission
from soter.config.toml_text import inline
from soter.errors import BackendError, ConfigError, IllFormedModule, RunFailed
from soter.loading import find_from_here
from soter.runner import Follower, Run, run_mission

if TYPE_CHECKING:
    from multiprocessing.synchronize import Event

OPTIONS: Final = {
    "backend": "--backend",
    "engine": "--engine",
    "targets": "--targets",
    "robots": "--robots",
    "planner": "--planner",
    "ac": "--ac",
    "seed": "--seed",
    "duration_s": "--duration",
}
"""Keys that have an option of `soter run`; all others are given by `--set`. `engine` is an option of the backend."""

HOST: Final = (
    "wall_s", "real_time_factor", "dm_tick_us", "missed_ticks", "tick_late_ms", "peer_age_ms", "peer_tick_us",
)  # fmt: skip
"""Figures of a result that depend on the host: two runs of one job may differ in these only."""

JUDGED: Final = "second_judge"
"""The key of the second judge's judgement in a result; see `soter.campaign.random.running`."""

FALLS: Final = "falls"
"""The key in a result of how the margin of `Job.falls_of` fell; see `soter.runner.Run`."""

LATE_S: Final = 30.0
"""Time beyond its limit after which a run's process is ended: a run that hangs may not stop by itself."""


@dataclass(frozen=True)
class Job:
    """One run.

    Attributes:
        number: the run's place in that part, from 0.
        mission: the mission file; empty for a drawn configuration.
        settings: value by dotted key of the mission file, and `engine`; a drawn configuration is drawn from `seed` and
            `engine`.
        axes: value by axis, as texts, that tell the run from others of its part; without the seed.
        limit_s: host time that the run may take; None for any.
        judged: whether a second judge judges the run; drawn configurations always are.
        folder: working directory, so that paths and the user's classes are found; empty for the process's own.
        sources: a hash over the code that the outcome depends on; see `soter.campaign.sources`.
        falls_of: the rule whose least margin is followed; empty for none.
    """

    part: str
    number: int
    mission: str
    settings: Mapping[str, Any]
    axes: Mapping[str, str]
    accept_unproved: bool = False
    limit_s: float | None = None
    judged: bool = False
    folder: str = ""
    sources: str = ""
    falls_of: str = ""

    @property
    def id(self) -> str:
        """Name of the run in its store: the same for the same part, mission and settings."""
        whole = [self.part, self.mission, dict(self.settings), self.accept_unproved, *filter(None, [self.falls_of])]
        return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:12]

    @property
    def seed(self) -> int:
        """The seed of all random numbers; 0 if only the mission file has it."""
        return int(self.settings.get("seed", 0))

    @property
    def command(self) -> str:
        """The command line that repeats the run."""
        if not self.mission:
            return f"soter campaign draw {self.seed} --engine {self.settings.get('engine', 'kinematic')}"
        words = ["soter", "run", self.mission]
        for key, option in OPTIONS.items():
            if key in self.settings:
                words += [option, str(self.settings[key])]
        for key, value in self.settings.items():
            if key not in OPTIONS:
                words += ["--set", f"{key}={inline(value)}"]
        words += ["--accept-unproved"] if self.accept_unproved else []
        return shlex.join([*words, "--no-record"])

    def load(self) -> MissionFile:
        """Return the mission with its settings.

        Raises:
            ConfigError: the mission, its workspace or a setting is not allowed.
        """
        overrides = {key: value for key, value in self.settings.items() if key != "engine"}
        return load_mission(self.mission, overrides, self.settings.get("engine"))


@dataclass
class Done:
    """The outcome of a run.

    Attributes:
        status: `done`; `refused`: bad input, or a module is ill-formed or not proved; `failed`: the run did not get to
            its end; `stopped`: the run was told to stop, and is not kept.
        failure: why it was refused or failed, in a line.
        trace: the traceback of an unexpected error; empty otherwise.
        result: `RunResult` without the figures that depend on the host; None if nothing was run.
        host: the figures that depend on the host.
        findings: faults found by the second judge.
    """

    status: str
    failure: str = ""
    trace: str = ""
    result: dict[str, Any] | None = None
    host: dict[str, Any] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, run: Run) -> Done:
        """Return the outcome of a run that ended by itself."""
        figures = run.result.model_dump(mode="json")
        host = {key: figures.pop(key) for key in HOST}
        # JSON has no NaN: a margin that was not a number.
        margins = figures["min_margin"] or {}
        margins.update({rule: None for rule, margin in margins.items() if math.isnan(margin)})
        # The job has the mission; a drawn configuration was in a folder that is gone by now.
        del figures["mission"]
        if run.falls:
            figures[FALLS] = [[*fall] for fall in run.falls]
        failed = run.result.status != "completed"
        return cls("failed" if failed else "done", run.result.failure, "", figures, host)


def carry_out(job: Job, stop: Callable[[], bool], record: Path | None = None) -> Done:
    """Run a job in this process's main thread; errors become part of the outcome.

    `stop` is called at every tick, and returns whether to end early; `record` is the file to record the run in, or
    None.
    """
    ends_s = time.monotonic() + (job.limit_s or float("inf"))
    late = f"no end after {job.limit_s or 0.0:g} s of the host's time"

    def ending() -> bool:
        return stop() or time.monotonic() > ends_s

    find_from_here()
    try:
        if job.judged or not job.mission:
            done = _judged(job, ending, record)
        else:
            follower = Follower(stop=ending, falls_of=job.falls_of)
            run = run_mission(job.load(), record=record, follower=follower, accept_unproved=job.accept_unproved)
            done = Done.of(run)
    except (ConfigError, BackendError, IllFormedModule) as refusal:
        return Done("refused", str(refusal))
    except RunFailed as failure:
        return Done("failed", str(failure))
    except Exception as failure:  # noqa: BLE001 - it is recorded, and must not stop the others
        return Done("failed", f"{type(failure).__name__}: {failure}", traceback.format_exc())
    if done.result is not None and done.result["status"] == "interrupted":
        return Done("stopped") if stop() else Done("failed", late)
    return done


def _judged(job: Job, stop: Callable[[], bool], record: Path | None) -> Done:
    from soter.campaign.random.running import run_drawn, run_judged

    if job.mission:
        run, judgement = run_judged(Path(job.mission), job.settings.get("duration_s"), stop, record)
    else:
        run, judgement = run_drawn(job.settings, stop, record)
    done = Done.of(run)
    assert done.result is not None
    # Through JSON, so that a result equals the same one from a store.
    done.result[JUDGED] = json.loads(json.dumps(asdict(judgement)))
    done.findings = judgement.findings
    return done


# --- in a worker -------------------------------------------------------------------------------------------------

_stop: Event | None = None


def begin(stop: Event) -> None:
    """Prepare a worker process. It ignores Ctrl-C, for which the first process sets `stop`, and dies with that one."""
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.disable(logging.CRITICAL)
    first = parent_process()
    if first is not None:
        threading.Thread(target=_die_with, args=(first.sentinel,), daemon=True).start()


def _die_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


def work(job: Job) -> Done:
    """Run a job in a worker.

    Raises:
        ConfigError: this worker has other sources than the one that planned the campaign.
    """
    from soter.campaign.sources import code_hash

    if job.sources and job.sources != code_hash():
        raise ConfigError(f"this worker has other sources: {code_hash()}, allowed: {job.sources}")
    if job.folder:
        os.chdir(job.folder)
    if job.limit_s is not None:
        faulthandler.dump_traceback_later(job.limit_s + LATE_S, exit=True)
    try:
        return carry_out(job, (lambda: False) if _stop is None else _stop.is_set)
    finally:
        faulthandler.cancel_dump_traceback_later()

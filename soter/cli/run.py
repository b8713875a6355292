"""`soter run`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from soter.cli import complete
from soter.cli.exits import ExitCode, Force, StopSignals, complain, guard
from soter.cli.option import option, switch
from soter.cli.overrides import MaybeMission, Settings, from_here, load_with_engine, merge, module_list
from soter.errors import ConfigError, option_error

if TYPE_CHECKING:
    from soter.cli.outputs import Outputs
    from soter.config import MissionFile
    from soter.runner import Run, RunResult

EXAMPLES = """Examples:
  soter run examples/surveillance.toml --picture run.png
  soter run examples/surveillance.toml --targets hostile --no-rta
  soter run --mission patrol.py --duration 120
  soter run examples/warehouse.toml --robots 3 --json result.json
  soter run examples/surveillance.toml --backend kinematic --ac adversary:chase
  soter run examples/surveillance.toml --ac greedy.py:Greedy
  soter run examples/surveillance.toml --set battery.initial.2=0.17
  soter run examples/surveillance.toml --record run.mcap
  soter run examples/surveillance.toml --live --open --pace 1
  soter run examples/surveillance.toml --duration 7200 --compare thesis
  soter run examples/distributed/mission.toml --process alpha
Exit codes:
  0  all went well
  1  ground truth counted a violation; with --strict also: an assumption failed, or a robot stalled for good, lost its
     AC for good, or never moved
  2  bad input, unusable backend, or a module that is ill-formed or not proved: nothing has moved
  3  the run failed, every robot lost its AC for good, as by an error in its script, or a robot was not under control
     for a time
  130  interrupted by Ctrl-C; the robots are stopped
"""


def run(
    mission: MaybeMission = None,
    what: Annotated[
        str | None,
        option(
            "NAME",
            "What is done: surveillance, FILE.py, FILE.py:Class or module:Class.",
            "--mission",
            autocompletion=complete.scripts,
        ),
    ] = None,
    backend: Annotated[
        str | None, option("NAME", "Which robots; `soter backends` lists them.", autocompletion=complete.backends)
    ] = None,
    engine: Annotated[
        str | None,
        option("NAME", "The backend's engine, such as pybullet or kinematic.", autocompletion=complete.engines),
    ] = None,
    duration: Annotated[float | None, option("SECONDS", "How long, in the robots' time.")] = None,
    seed: Annotated[int | None, option("N", "Everything random is drawn from it.")] = None,
    targets: Annotated[
        str | None, option("grid|uniform|hostile", "Where the robots are sent.", autocompletion=complete.targets)
    ] = None,
    robots: Annotated[int | None, option("N", "Only the first N of the workspace.")] = None,
    planner: Annotated[
        str | None, option("NAME", "The untrusted motion planner.", autocompletion=complete.planners)
    ] = None,
    ac: Annotated[
        str | None,
        option(
            "NAME",
            "Who the ACs are: mission, adversary:NAME, FILE.py:Class or module:Class.",
            autocompletion=complete.controllers,
        ),
    ] = None,
    process: Annotated[
        str | None, option("NAME", "Which process of a distributed mission this is, see docs/distribution.md.")
    ] = None,
    no_rta: Annotated[bool, switch("--no-rta", "Remove the decision modules, and nothing else.")] = False,
    modules: Annotated[
        str | None, option("A,B", "Only these safety modules, separated by commas.", autocompletion=complete.modules)
    ] = None,
    json: Annotated[Path | None, option("FILE", "Write the result; - is standard output.")] = None,
    picture: Annotated[Path | None, option("FILE.png", "Draw the run.")] = None,
    record: Annotated[
        Path | None, option("FILE.mcap", "Record the run there instead of into a new file in runs/.")
    ] = None,
    sign: Annotated[
        Path | None, option("KEY.pem", "Sign the recording with this private key (Ed25519), for `soter verify`.")
    ] = None,
    no_record: Annotated[bool, switch("--no-record", "Do not record the run.")] = False,
    live: Annotated[bool, switch("--live", "Show the run in a browser of this host while it goes on.")] = False,
    live_port: Annotated[
        int | None, option("N", "Where: a port of 127.0.0.1; else a free one.", min=1, max=65535)
    ] = None,
    gui: Annotated[
        bool, switch("--gui", "Show PyBullet's world in a window, held to the clock unless --pace differs.")
    ] = False,
    open_it: Annotated[bool, switch("--open", "Open the live page in the browser of this host.")] = False,
    leave: Annotated[
        bool, switch("--leave", "End when the run does, instead of keeping the live page until Ctrl-C.")
    ] = False,
    pace: Annotated[
        float | None,
        option("N", "Hold virtual time to N times the clock; without it is as fast as it can be.", min=0.01, max=1e6),
    ] = None,
    foxglove: Annotated[bool, switch("--foxglove", "Show the run in the Foxglove app while it goes on.")] = False,
    foxglove_port: Annotated[
        int | None, option("N", "Where: a port of 127.0.0.1; else 8765.", min=1, max=65535)
    ] = None,
    settings: Settings = None,
    accept_unproved: Annotated[
        bool, switch("--accept-unproved", "Run what cannot be proved safe; the summary and the result say so.")
    ] = False,
    strict: Annotated[
        bool,
        switch(
            "--strict",
            "Exit with 1 where an assumption failed, or a robot stalled for good, lost its AC for good, or "
            "never moved.",
        ),
    ] = False,
    compare: Annotated[
        Literal["thesis"] | None,
        option("thesis", "Show the figures of the thesis that SOTER follows beside the run's."),
    ] = None,
    force: Force = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no summary, only errors.")] = False,
) -> None:
    """Run a mission and say how it went.

    Options take the place of what the mission file says.
    """
    with guard():
        from soter.cli.console import make_console
        from soter.cli.live import Views, pace_of
        from soter.cli.outputs import Outputs
        from soter.cli.progress import make_display
        from soter.cli.recordings import recording_path, show_recording, unless_recorded
        from soter.cli.summary import print_summary
        from soter.config.tables import SURVEILLANCE
        from soter.record.signing import read_private_key
        from soter.runner import Follower, run_mission

        if no_rta and modules is not None:
            raise option_error("--modules", "it contradicts --no-rta; give one of them")
        if mission is None:
            if what is None and ac is None:
                raise ConfigError(
                    "name a mission file, with --mission what is to be done, or with --ac who drives",
                    source="command line",
                )
            from soter.missions import ROOM

            mission = ROOM
        options = {
            "mission": from_here(what),
            "backend": backend,
            "duration_s": duration,
            "seed": seed,
            "targets": targets,
            "robots": robots,
            "planner": planner,
            "ac": from_here(ac),
            "rta.enabled": False if no_rta else None,
            "rta.modules": None if modules is None else module_list(modules),
        }
        if gui:
            options["backends.pybullet.window"] = True
        loaded = load_with_engine(mission, merge(options, settings), engine)
        if gui and loaded.backend != "pybullet":
            raise ConfigError(
                f"the backend '{loaded.backend}' has no window, allowed: pybullet; --live shows every backend",
                source="command line", key="--gui",
            )  # fmt: skip
        files = Outputs(
            {"--json": json, "--picture": picture, "--record": record}, (mission, loaded.workspace), force=force
        )
        if compare is not None and (loaded.ac != "mission" or loaded.mission.use != SURVEILLANCE):
            driven = f"the mission is {loaded.mission.use}" if loaded.ac == "mission" else f"the ACs are {loaded.ac}"
            raise option_error("--compare", f"the figures are those of the surveillance mission, but {driven}")
        views = Views(live, live_port, foxglove, foxglove_port, opened=open_it, leave=leave)
        if sign is not None:
            read_private_key(sign, "--sign")
        recording = recording_path(record, no_record, loaded, process)
        console = make_console(stderr=files.to_stdout)
        stop = StopSignals()
        held = pace_of(1.0 if gui and pace is None else pace, loaded, stop)
        with unless_recorded(recording), views.shown(recording, console) as kept:
            display = None if quiet else make_display(console, loaded.source or "")
            with stop, display or nullcontext():
                follower = Follower(
                    show=display.update if display else None,
                    stop=stop,
                    pace=held,
                    connecting=stop.raising,
                    trying=display.trying if display else None,
                    say=lambda words: console.print(words, soft_wrap=True, highlight=False),
                    recording=views.begin,
                )
                done = run_mission(
                    loaded, record=kept, sign=sign, follower=follower, accept_unproved=accept_unproved,
                    process=process,
                )  # fmt: skip
            if not quiet:
                print_summary(console, done.result, compared=compare is not None)
                if recording is not None and done.recording is not None:
                    show_recording(console, done.recording)
            written = _write(done, loaded, files)
            if record is not None and done.recording is not None and done.recording.failure:
                complain(f"the recording is not complete: {done.recording.failure}")
                written = False
            troubles = done.result.troubles if strict else []
            if troubles:
                complain(f"--strict: {'; '.join(troubles)}")
            elif done.result.status == "completed" and done.result.abandoned:
                complain(f"no robot has its AC any more: {'; '.join(done.result.abandoned)}")
            if stop.received is None:
                views.stay(console)
        raise typer.Exit(_exit_code(done.result, stop.received, troubles) if written else ExitCode.RUN_FAILED)


def _write(done: Run, mission: MissionFile, files: Outputs) -> bool:
    """Write the files that were asked for; return whether all could be written."""

    def result() -> bytes:
        return f"{done.result.model_dump_json(indent=2)}\n".encode()

    def picture() -> bytes:
        from soter.cli.summary import caption
        from soter.report.picture import draw_png

        return draw_png(done.tracks, caption(done.result, mission.rta.battery.phi_safer))

    written = True
    for option_name, make in (("--json", result), ("--picture", picture)):
        try:
            files.write(option_name, make)
        except OSError as failure:
            complain(f"the {make.__name__} could not be written: {failure}")
            written = False
    return written


def _exit_code(result: RunResult, stopped_by: int | None, troubles: Sequence[str] = ()) -> int:
    if result.status == "interrupted":
        return 128 + stopped_by if stopped_by is not None else ExitCode.INTERRUPTED
    if result.violated:
        return ExitCode.VIOLATION
    if result.status == "failed" or result.uncontrolled or result.abandoned:
        return ExitCode.RUN_FAILED
    return ExitCode.VIOLATION if troubles else ExitCode.OK

"""What a recording has beside its messages: files, among them what was run, and what came of it."""

from __future__ import annotations

from typing import Annotated, Final

from msgspec import Meta, field

from soter.record.messages import Message, StateMessage, Whole


class PeerAbout(Message):
    """One robot that another process supervises.

    Attributes:
        robot_id: its number.
        capabilities: what it promises, by name; what it leaves open is left out.
    """

    robot_id: Whole
    capabilities: dict[str, float | bool | str]


class RobotAbout(Message):
    """One robot of a run.

    Attributes:
        robot_id: its number.
        capabilities: what it promised, by name; what it left open is left out.
        initial: the sample before the first tick.
        modules: its modules.
    """

    robot_id: Whole
    capabilities: dict[str, float | bool | str]
    initial: StateMessage
    modules: tuple[ModuleAbout, ...]


class ModuleAbout(Message):
    """One module of one robot, as declared.

    Attributes:
        name: its name.
        delta_s: its Delta.
        dwell_s: how long phi_safer must hold before control goes back.
        unit: of its margin; empty where the rule is given by predicates.
        edge_margin: the margin at the edge of phi_safer; None where it has none.
        horizon_reach: the most that the margin can fall within the horizon H; None where there is no model.
    """

    name: str
    delta_s: float
    dwell_s: float
    unit: str = ""
    edge_margin: float | None = None
    horizon_reach: float | None = None


class About(Message):
    """What was run, where, with what. Kept in a recording as the attachment `about.json`.

    Attributes:
        version: of the messages.
        mission: the effective mission, with what the command line changed, as TOML tables.
        source: the mission file, empty if it was made in code.
        backend: name of the backend.
        seed: of the mission.
        base_tick_s: period of the tick.
        virtual_time: whether time stood still while nobody slept.
        started_utc: when, in ISO 8601.
        modules: names of the modules, in their order.
        robots: all of them, in the order of the supervisor.
        versions: of SOTER, Python, the platform and the libraries, by name.
        peers: robots of other processes.
        accepted_unproved: what was run although it is not proved.
    """

    version: int
    mission: dict[str, object]
    source: str
    backend: str
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)]
    base_tick_s: float
    virtual_time: bool
    started_utc: str
    modules: tuple[str, ...]
    robots: tuple[RobotAbout, ...]
    versions: dict[str, str]
    peers: tuple[PeerAbout, ...] = ()
    accepted_unproved: tuple[str, ...] = ()


class FailedAssumption(Message):
    """At how many looks an assumption did not hold, as a result says; the first, in fleet time, and its cause."""

    times: Whole
    first_s: float
    cause: str


class Result(Message):
    """What readers take from the result of a run, `result.json`; all of it is `soter.runner.RunResult`.

    Attributes:
        status: how the run ended.
        duration_s: how long it went on, in fleet time.
        failure: why it failed.
        engine: of the backend.
        violations: by rule; None where there was no truth.
        min_margin: by rule, likewise.
        truth_ended_s: fleet time at which ground truth fell silent.
        trace_sha256: of all states and decisions.
        assumptions: by robot and number, those that were seen not to hold.
        never_moved: robots that stood still.
    """

    status: str
    duration_s: float = 0.0
    failure: str = ""
    engine: str | None = None
    violations: dict[str, Whole] | None = None
    min_margin: dict[str, float | None] | None = None
    truth_ended_s: float | None = None
    trace_sha256: str | None = None
    assumptions: dict[Whole, dict[str, FailedAssumption]] = field(default_factory=dict)
    never_moved: tuple[Whole, ...] = ()


ABOUT_JSON: Final = "about.json"
MISSION_TOML: Final = "mission.toml"
WORKSPACE_XML: Final = "workspace.xml"
SITE_JSON: Final = "site.json"
"""A workspace that is made of polygons, whatever file it was read from."""

RESULT_JSON: Final = "result.json"

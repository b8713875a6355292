"""The attachments of a recording, beside its messages: files, among them the run's description and its result."""

from __future__ import annotations

from typing import Annotated, Final

from msgspec import Meta, field

from soter.record.messages import Message, StateMessage, Whole


class PeerAbout(Message):
    """One robot that another process supervises; of the run's own robots, there is more in `RobotAbout`.

    Attributes:
        robot_id: its number.
        capabilities: what it promises, by name, without what it leaves open.
    """

    robot_id: Whole
    capabilities: dict[str, float | bool | str]


class RobotAbout(PeerAbout):
    """One robot of a run.

    Attributes:
        initial: the sample before the first tick.
        modules: its modules.
    """

    initial: StateMessage
    modules: tuple[ModuleAbout, ...]


class ModuleAbout(Message):
    """One module of one robot, as declared.

    Attributes:
        dwell_s: how long phi_safer must hold before control goes back.
        unit: the unit of its margin; empty if the rule is given by predicates.
        edge_margin: the margin at the edge of phi_safer; None without one.
        horizon_reach: the most that the margin can fall within the horizon H; None without a model.
    """

    name: str
    delta_s: float
    dwell_s: float
    unit: str = ""
    edge_margin: float | None = None
    horizon_reach: float | None = None


class About(Message):
    """The description of a run. Kept in a recording as the attachment `about.json`.

    Attributes:
        version: the version of the messages.
        mission: the effective mission, with the command line's changes, as TOML tables.
        source: the mission file; empty if the mission was made in code.
        base_tick_s: period of the tick.
        virtual_time: whether time stood still while nobody slept.
        started_utc: when the run started, in ISO 8601.
        modules: names of the modules, in their order.
        robots: all robots, in the order of the supervisor.
        versions: the versions of SOTER, Python, the platform and the libraries, by name.
        peers: robots of other processes.
        accepted_unproved: what the user accepted without proof.
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
    """A failed assumption in a result: the number of looks at which it failed, fleet time and cause of the first."""

    times: Whole
    first_s: float
    cause: str


class Result(Message):
    """The parts of a run's result, `result.json`, that readers use; the whole is `soter.runner.RunResult`.

    Attributes:
        status: how the run ended.
        duration_s: how long the run lasted, in fleet time.
        violations: number by rule; None without ground truth.
        min_margin: least margin by rule; None without ground truth.
        truth_ended_s: fleet time at which ground truth fell silent.
        trace_sha256: hash of all states and decisions.
        assumptions: failed assumptions, by robot and number.
        never_moved: robots that stood still all the time.
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
"""Name of the attachment with a workspace made of polygons, whatever file it was read from."""

RESULT_JSON: Final = "result.json"

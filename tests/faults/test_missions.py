"""Missions under faults: the rules hold within declared bounds, and what cannot be promised is refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest

from soter.adapters.pybullet import KinematicBackend, SimulatedFleet, SimulatedRobot
from soter.campaign.plan import load_campaign
from soter.clock import VirtualClock
from soter.config import load_mission
from soter.errors import ConfigError, IllFormedModule, Unsupported
from soter.faults import Fault, FaultOptions, Passage, SentCommand
from soter.runner import Follower, RunResult, run_mission
from soter.sdk import Fleet, Robot, RobotSpec, RobotState
from soter_sim import World

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples" / "faults").glob("*.toml"))
QUICK = {"backend": "kinematic", "planner": "straight-line"}
CAMPAIGN = load_campaign(ROOT / "examples" / "campaigns" / "faults.toml")
WITHIN = {
    axes["fault"]: settings for name in ("within", "within-wider") for axes, settings in CAMPAIGN.parts[name].rows()
}
"""By the fault's name, the settings of those within declared bounds."""


def run(*tables: dict[str, Any], **overrides: Any) -> RunResult:
    given = {**QUICK, "targets": "hostile", "duration_s": 120.0, "fault": [*tables], **overrides}
    return run_mission(load_mission(ROOT / "examples" / "surveillance.toml", given)).result


@pytest.mark.parametrize("name", WITHIN)
def test_no_rule_is_broken_within_declared_bounds(name: str) -> None:
    result = run(**{**WITHIN[name], "targets": "hostile", "duration_s": 120.0, "seed": 7})
    assert result.status == "completed"
    assert result.violations == {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
    assert result.ac_share > 0.4
    assert result.no_certified_motion == 0
    assert all(fault.declared and fault.affected for fault in result.faults)


def test_a_bound_that_the_modules_cannot_pay_for_is_refused() -> None:
    with pytest.raises(IllFormedModule, match=r"collision.*P3.*latency \+ age \+ jitter = 0\.350 s"):
        run({"kind": "delay", "commands_s": 0.2}, rta={"collision": {"phi_safer_m": 0.5}})
    assert run({"kind": "delay", "commands_s": 0.2, "declared": False}, duration_s=5.0).status == "completed"


@pytest.mark.parametrize("kind", ["kill", "freeze"])
def test_a_robot_goes_home_to_charge_although_its_peer_is_silent_for_good(kind: str) -> None:
    """Its charge would last for five minutes; that of the silent one, which nobody can drive home, for all the run."""
    silent = {"kind": kind, "robot": 2, "start_s": 60.0, "declared": False}
    battery = {"drive_s": 500.0, "idle_s": 600.0, "initial": {1: 0.5, 2: 1.0}}
    result = run(silent, battery=battery, duration_s=450.0)
    assert result.violations == {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
    assert result.min_margin is not None
    assert result.min_margin["battery"] > 0.05
    assert "not heard of" in result.assumptions[1]["A7"].cause


def test_what_is_not_declared_can_break_a_rule() -> None:
    result = run_mission(load_mission(ROOT / "examples" / "faults" / "not-declared.toml", QUICK)).result
    assert result.violated
    assert not any(fault.declared for fault in result.faults)


def test_faults_repeat_bit_for_bit() -> None:
    tables = [
        {"kind": "loss", "samples": 0.3},
        {"kind": "delay", "commands_s": 0.01, "jitter_s": 0.03, "robot": 1},
    ]
    first, again, other = (run(*tables, seed=seed) for seed in (1, 1, 2))
    assert first.trace_sha256 == again.trace_sha256 != other.trace_sha256
    assert first.faults == again.faults


def test_faults_that_draw_anew_from_a_time_on_are_what_they_were_up_to_then() -> None:
    def way(*seeds: int) -> tuple[list[float], list[float]]:
        reseed = [{"at_s": 10.0 + at, "seed": seed} for at, seed in enumerate(seeds)]
        overrides = {**QUICK, "duration_s": 20.0, "fault": [{"kind": "loss", "samples": 0.4}], "reseed": reseed}
        done = run_mission(
            load_mission(ROOT / "examples" / "surveillance.toml", overrides), follower=Follower(falls_of="geofence")
        )
        assert done.result.min_margin is not None
        margins = [margin for _, margin in done.falls]
        assert margins == sorted(set(margins), reverse=True)
        assert margins[-1] == done.result.min_margin["geofence"]
        times, places = done.tracks.tracks[1].time_s, done.tracks.tracks[1].x_m
        since = next(at for at, time_s in enumerate(times) if time_s > 10.0)
        return [*places[:since]], [*places[since:]]

    ways = [way(), way(1), way(2), way(2, 1), way(2, 1)]
    assert all(before == ways[0][0] for before, _ in ways)
    assert len({tuple(after) for _, after in ways}) == 4
    assert ways[3] == ways[4]


class Drawn(Fault[FaultOptions]):
    """Draws at every sample and command, by a source that keeps every second number of a pair, and spoils nothing."""

    options_model = FaultOptions
    all: ClassVar[list[tuple[int, float, float]]]

    def command(self, time_s: float, command: SentCommand) -> Sequence[Passage]:
        self._draw(time_s)
        return super().command(time_s, command)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        self._draw(time_s)
        return sample

    def _draw(self, time_s: float) -> None:
        self.all.append((self.context.robot_id, time_s, self.context.random.gauss(0.0, 1.0)))


@pytest.mark.parametrize("at_s", [1.0, 1.05, 1.1])
def test_nothing_that_is_drawn_from_a_time_on_is_what_it_was(at_s: float) -> None:
    """A number that were the same in two branches would make their futures alike, and an estimate from them wrong."""

    def drawn(*seeds: int) -> list[tuple[int, float, float]]:
        Drawn.all = []
        reseed = [{"at_s": at_s, "seed": seed} for seed in seeds]
        run(*[{"kind": "tests.faults.test_missions:Drawn"}] * 2, duration_s=2.0, reseed=reseed)
        return Drawn.all

    plain, one, other = drawn(), drawn(1), drawn(2)
    before = [each for each in plain if each[1] < at_s - 1e-6]
    since = len(before)
    assert plain[:since] == one[:since] == other[:since] == before
    after = [each[2] for draws in (plain, one, other) for each in draws[since:]]
    assert len({*after}) == len(after) > 300, "faults of all robots, each from numbers of its own"


def test_a_mission_without_faults_is_what_it_was() -> None:
    assert run(duration_s=10.0).faults == ()


def test_a_wrong_table_is_refused_before_the_backend_is_opened() -> None:
    with pytest.raises(ConfigError, match=r"fault\.0\.kind"):
        run({"kind": "gremlin"}, backend="tests.faults.test_missions:NeverOpened")


class NeverOpened(KinematicBackend):
    """A backend that must not be opened."""

    def open(self, config: Any, robots: Any) -> SimulatedFleet:
        raise AssertionError("it was opened")


class WholeRobot(SimulatedRobot, overrides=("init",)):
    """A robot without the optional hook."""

    impair: ClassVar[None] = None  # type: ignore[assignment]
    started = 0

    def init(self, timeout_s: float) -> None:
        WholeRobot.started += 1
        super().init(timeout_s)


class WholeFleet(Fleet):
    """Robots of a world that cannot be impaired."""

    def __init__(self, world: World, specs: list[RobotSpec]) -> None:
        clock = VirtualClock(world.advance)
        super().__init__(clock, [WholeRobot(spec, clock, world) for spec in specs], world.truth)

    def _close(self) -> None:
        """Nothing is shared."""


class WholeBackend(KinematicBackend):
    """A backend whose vehicles cannot be impaired, as on a wire."""

    robot_class: ClassVar[type[Robot]] = WholeRobot  # type: ignore[assignment] # `open` below makes them

    def open(self, config: Any, robots: Any) -> Any:
        return WholeFleet(World(config.workspace, robots, "kinematic"), robots)


def test_a_backend_without_the_hook_refuses_faults_of_vehicles_before_anything_moves() -> None:
    backend = "tests.faults.test_missions:WholeBackend"
    with pytest.raises(Unsupported, match="a WholeRobot cannot"):
        run({"kind": "kill", "start_s": 1.0}, backend=backend)
    assert WholeRobot.started == 0
    assert run({"kind": "bias", "x_m": 0.02}, backend=backend, duration_s=60.0).violations is not None


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_run(path: Path) -> None:
    result = run_mission(load_mission(path, {**QUICK, "duration_s": 130.0})).result
    assert result.status == "completed"
    assert all(fault.affected for fault in result.faults)
    assert not result.violated or path.stem == "not-declared"

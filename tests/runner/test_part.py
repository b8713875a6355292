"""Which part of a mission a process has, and what is refused before anything moves."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Self

import pytest
from pydantic import BaseModel

from soter.adapters.zenoh.bus import ZenohBus
from soter.cli.recordings import recording_path
from soter.config import MissionFile, load_mission
from soter.distribution.bus import Bus, bus_class
from soter.errors import ConfigError
from soter.runner import run_mission
from soter.runner.boxes import box_of
from soter.runner.part import Part
from tests.distribution.air import MemoryBus

EXAMPLE = Path(__file__).parents[2] / "examples" / "distributed" / "mission.toml"


def mission(**overrides: Any) -> MissionFile:
    return load_mission(EXAMPLE, {key.replace("__", "."): value for key, value in overrides.items()})


def part(process: str, **overrides: Any) -> Part:
    given = mission(**overrides)
    return Part.of(given, given.read_workspace(), process)


def test_every_process_knows_what_is_its_own_and_who_has_the_rest() -> None:
    alpha, ground = part("alpha"), part("ground")
    assert (alpha.robots, alpha.planner, alpha.planner_home) == ((1,), False, "ground")
    assert (ground.robots, ground.planner, ground.others) == ((), True, ("alpha", "beta"))
    assert alpha.homes == ground.homes == {1: "alpha", 2: "beta"}
    assert set(alpha.promised) == {1, 2}


def test_controllers_need_no_task_planner() -> None:
    alpha = part("alpha", ac="adversary:chase")
    assert (alpha.robots, alpha.planner, alpha.planner_home, alpha.others) == ((1,), False, "", ("beta",))
    assert alpha.digest == part("beta", ac="own.py:Own").digest != part("alpha").digest
    machines, controllers = (box_of(each.mission, each) for each in (part("alpha"), alpha))
    assert machines is not None
    assert controllers is not None
    assert (machines.network, controllers.network) == (True, False), "controllers talk to nobody"
    without = {"alpha": {"robots": [1]}, "beta": {"robots": [2]}}
    assert part("beta", distribution__processes=without, ac="adversary:chase").others == ("alpha",)
    with pytest.raises(ConfigError, match="planner = true in exactly one process; it is in none"):
        part("beta", distribution__processes=without)


def test_processes_of_one_mission_agree_and_others_do_not() -> None:
    digest = part("alpha").digest
    assert digest == part("beta").digest == part("ground").digest
    same: list[dict[str, Any]] = [
        {"duration_s": 5.0}, {"seed": 7}, {"planner": "ompl-bitstar"}, {"distribution__wait_s": 5.0},
        {"distribution__bus__connect": ["tcp/127.0.0.1:7999"]}, {"backends__zenoh__discovery_s": 20.0},
    ]  # fmt: skip
    for overrides in same:
        assert part("alpha", **overrides).digest == digest, overrides
    another: list[dict[str, Any]] = [
        {"rta__collision__delta_s": 0.1}, {"base_tick_s": 0.025}, {"rta__modules": ["collision"]},
        {"distribution__processes__alpha__robots": [2], "distribution__processes__beta__robots": [1]},
        {"fault": [{"kind": "delay", "commands_s": 0.01, "declared": True}]}, {"battery__drive_s": 900.0},
    ]  # fmt: skip
    digests = {part("alpha", **overrides).digest for overrides in another}
    assert len(digests | {digest}) == len(another) + 1


def test_processes_that_would_not_understand_each_other_do_not_talk(monkeypatch: pytest.MonkeyPatch) -> None:
    digest = part("alpha").digest
    monkeypatch.setattr("soter.runner.part.VERSION", 99)
    assert part("alpha").digest != digest


def test_faults_that_are_declared_widen_what_others_expect_of_a_robot() -> None:
    plain, slow = (
        part("beta"),
        part("beta", fault=[{"kind": "delay", "robot": 1, "commands_s": 0.01, "declared": True}]),
    )
    assert slow.promised[1].latency_s == pytest.approx(plain.promised[1].latency_s + 0.01)
    assert slow.promised[2] == plain.promised[2]


@pytest.mark.parametrize(
    ("process", "overrides", "words"),
    [
        ("alpah", {}, r"there is no 'alpah', did you mean 'alpha'\?; known are alpha, beta, ground"),
        ("alpha", {"distribution__processes": {}}, r"it names no processes, so that there is no 'alpha'"),
        ("alpha", {"backend": "kinematic"}, r"'kinematic', .* virtual time in one process; allowed with processes"),
        ("ground", {"ac": "adversary:chase"}, r"processes.ground: it has no robots, .* 'adversary:chase'"),
        ("ground", {"distribution__via": "zeno"}, r"via: unknown bus 'zeno', did you mean 'zenoh'\?"),
        ("ground", {"distribution__via": "no.such:Bus"}, r"via: it is 'no.such:Bus', but there is no module 'no'"),
        (
            "ground",
            {"distribution__via": "pathlib:Path"},
            r"'pathlib:Path', which is no bus; allowed: a class with options_model",
        ),
        ("ground", {"distribution__bus__mode": "star"}, r"distribution.bus.mode: it is 'star', allowed: 'peer'"),
        ("ground", {"distribution__processes__ground__bus": {"mod": 1}}, r"ground.bus.mod: unknown key, did you mean"),
    ],
)
def test_what_cannot_be_is_refused_by_name(process: str, overrides: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        run_mission(mission(**overrides), process=process)


def test_a_process_without_robots_records_nothing(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"process 'ground' has no robots, and so there is nothing to record"):
        run_mission(mission(), process="ground", record=tmp_path / "run.mcap")
    assert recording_path(None, False, mission(), "ground") is None


def test_a_distributed_mission_is_not_run_as_a_whole_by_mistake() -> None:
    with pytest.raises(ConfigError, match=r"say which process this is: --process alpha or --process beta"):
        run_mission(mission())


def test_in_virtual_time_a_distributed_mission_runs_in_one_process() -> None:
    result = run_mission(mission(backend="kinematic", duration_s=5.0)).result
    assert result.status == "completed"
    assert (result.robots, result.process, result.peer_age_ms) == (2, "", None)


class Tin(BaseModel):
    """Options of a bus of one's own."""

    length_m: float = 1.0


class TinBus:
    """A bus of one's own."""

    options_model: ClassVar[type[BaseModel]] = Tin
    opened: ClassVar[list[Tin]] = []

    @classmethod
    def open(cls, options: Any) -> Self:
        cls.opened.append(options)
        return cls()

    def publish(self, key: str, payload: bytes) -> None: ...

    def subscribe(self, key: str, hear: object) -> None: ...

    def close(self) -> None: ...


def test_what_calls_itself_a_bus_is_one() -> None:
    # What they have to be is checked by types; what they do, by tests of their own.
    buses: list[type[Bus]] = [TinBus, MemoryBus, ZenohBus]
    assert bus_class("zenoh", ConfigError) is buses[-1]


def test_a_bus_may_be_ones_own_and_a_process_may_have_options_of_its_own() -> None:
    asked = {"distribution__via": "tests.runner.test_part:TinBus", "distribution__bus": {"length_m": 2.0}}
    for own in ({}, {"length_m": 3.0}):
        part("alpha", **asked, distribution__processes__alpha__bus=own).open_bus()
    assert [options.length_m for options in TinBus.opened] == [2.0, 3.0]

"""What may stand in a `[[fault]]` table, and what is said about what may not."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, cast

import pytest

from soter.check.mission import check_mission
from soter.config import load_mission, parse_mission
from soter.errors import ConfigError
from soter.faults import (
    BUILT_IN,
    Context,
    Fault,
    FaultOptions,
    Impairment,
    Passage,
    SentCommand,
    Spacing,
    read_faults,
)
from soter.runner import run_mission
from soter.sdk import Capabilities, RobotState
from soter.specs import promises_of
from tests.faults.bench import mission
from tests.project.source import ROOT

HEAD = 'workspace = "room.xml"\n'
ENOUGH: dict[str, dict[str, Any]] = {
    "delay": {"samples_s": 0.05},
    "loss": {"commands": 0.1},
    "duplicate": {"samples": 0.1},
    "freeze": {"duration_s": 0.1},
    "bias": {"x_m": 0.01},
    "clock_step": {"step_s": -0.05},
    "battery": {"offset": -0.1},
    "wheel_slip": {"left": 0.96},
    "weak_brakes": {"factor": 0.9},
    "kill": {"start_s": 0.05},
}
"""The least that each kind must be told."""


class Hum(Fault[FaultOptions]):
    """A kind of somebody else's."""

    options_model = FaultOptions


class Unfinished(Fault[FaultOptions]):
    """A kind that does not say what its table looks like."""


class Fails(Fault[FaultOptions]):
    """A kind of somebody else's that fails in one of its methods."""

    options_model = FaultOptions
    where, how = "", "raises"

    def __init__(self, options: FaultOptions, context: Context) -> None:
        self._do("__init__")
        super().__init__(options, context)

    def _do(self, method: str) -> bool:
        if method == self.where and self.how != "answers":
            raise SystemExit(3) if self.how == "exits" else RuntimeError("out of order")
        return method == self.where

    def widened(self, capabilities: Capabilities) -> Capabilities:
        return cast(Capabilities, "much") if self._do("widened") else capabilities

    def spacing(self) -> Spacing:
        return cast(Spacing, "much") if self._do("spacing") else Spacing()

    def command(self, time_s: float, command: SentCommand) -> Sequence[Passage]:
        return cast(Sequence[Passage], "much") if self._do("command") else (Passage(command),)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        return cast(RobotState, "much") if self._do("sample") else sample

    def impairment(self) -> Impairment | None:
        return cast(Impairment, "much") if self._do("impairment") else None


def refusal(**table: Any) -> str:
    with pytest.raises(ConfigError) as refused:
        read_faults(mission(table), [1, 2])
    return str(refused.value)


@pytest.mark.parametrize("kind", BUILT_IN)
def test_every_kind_has_defaults_and_names_unknown_keys(kind: str) -> None:
    (table,) = read_faults(mission({"kind": kind, **ENOUGH[kind]}), [1, 2])
    assert table.hits(1)
    assert table.hits(2)
    assert table.options.start_s == ENOUGH[kind].get("start_s", 0.0)
    assert table.options.declared
    assert "fault.0.strength: unknown key; allowed: kind, robot, start_s" in refusal(
        kind=kind, strength=3, **ENOUGH[kind]
    )


def test_a_fault_that_hides_a_robot_from_the_beginning_is_refused_and_what_it_names_runs() -> None:
    tables: list[dict[str, Any]] = [
        {"kind": "kill"}, {"kind": "kill", "duration_s": 0.5, "every_s": 1.0}, {"kind": "kill", "start_s": 1e-12},
        {"kind": "clock_step", "step_s": 10.0, "declared": False},
    ]  # fmt: skip
    for table in tables:
        with pytest.raises(ConfigError, match=r"fault\.0\.start_s: it is .*robot 2.*above 0, such as 0\.05"):
            read_faults(mission({**table, "robot": 2}), [1, 2])
        again = {**table, "robot": 2, "start_s": 0.05}
        asked = {"backend": "kinematic", "planner": "straight-line", "duration_s": 1.0, "fault": [again]}
        assert run_mission(load_mission(ROOT / "examples" / "surveillance.toml", asked)).result.status == "completed"


def test_a_fault_can_hit_one_robot() -> None:
    (table,) = read_faults(mission({"kind": "kill", "robot": 2, "start_s": 0.05}), [1, 2])
    assert [table.hits(robot) for robot in (1, 2)] == [False, True]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, "fault.0.kind: it is missing, and has no default; known kinds are delay, loss"),
        ({"kind": 3}, "fault.0.kind: it is 3, allowed: a text in quotes"),
        ({"kind": "dealy"}, "fault.0.kind: unknown kind 'dealy', did you mean 'delay'?; known are delay, loss"),
        ({"kind": "no.such.module:Kind"}, "there is no module 'no'"),
        ({"kind": "soter.faults:FaultOptions"}, "allowed: a subclass of Fault"),
        ({"kind": "soter.faults:Nothing"}, "there is no 'Nothing' in it"),
        ({"kind": "tests.faults.test_tables:Unfinished"}, "it needs an 'options_model'"),
        ({"kind": "kill", "robot": 3}, 'fault.0.robot: it is 3, but there is no such robot; allowed: "all", 1, 2'),
        (
            {"kind": "kill", "robot": "2"},
            "fault.0.robot: it is '2', allowed: 'all', or the id of a robot, a whole",
        ),
        ({"kind": "kill", "robot": 0}, "fault.0.robot: it is 0, allowed: 'all', or the id of a robot, a whole"),
        ({"kind": "kill", "start_s": -1.0}, "fault.0.start_s: it is -1.0, allowed: at least 0"),
        ({"kind": "kill", "duration_s": "1"}, "fault.0.duration_s: it is '1', allowed: a number"),
        ({"kind": "kill", "every_s": 5.0}, "fault.0.every_s: it is 5.0, allowed: a fault with a duration_s"),
        ({"kind": "kill", "duration_s": 5.0, "every_s": 5.0}, "fault.0.every_s: it is 5.0, allowed: above duration_s"),
        ({"kind": "delay"}, "fault.0.commands_s: it is 0.0, allowed: above 0, or a samples_s or jitter_s"),
        ({"kind": "loss"}, "fault.0.commands: it is 0.0, allowed: above 0"),
        ({"kind": "loss", "samples": 1.5}, "fault.0.samples: it is 1.5, allowed: at most 1"),
        ({"kind": "loss", "samples": 0.1, "burst": 0}, "fault.0.burst: it is 0, allowed: 1 or more; or declared"),
        ({"kind": "loss", "commands": 0.1, "resend": False}, "fault.0.resend: it is False, allowed: true; or declared"),
        ({"kind": "duplicate"}, "fault.0.commands: it is 0.0, allowed: above 0"),
        ({"kind": "duplicate", "commands": 0.1, "reorder": True}, "fault.0.reorder: it is True, allowed: false; or"),
        ({"kind": "freeze"}, "fault.0.declared: it is True, allowed: false; or give a duration_s"),
        ({"kind": "bias"}, "fault.0.x_m: it is 0.0, allowed: other than 0"),
        ({"kind": "clock_step", "step_s": 0.0}, "fault.0.step_s: it is 0.0, allowed: other than 0"),
        ({"kind": "clock_step", "step_s": 0.1}, "puts the clock of robot 1 0.1 s ahead; allowed: below 0.1 s in all"),
        ({"kind": "battery", "offset": 0.1}, "fault.0.offset: it is 0.1, allowed: at most 0; or declared = false"),
        ({"kind": "wheel_slip"}, "fault.0.left: it is 1.0, allowed: below 1"),
        ({"kind": "wheel_slip", "left": 0.9}, "fault.0.left: it is 0.9, allowed: at most 0.05 apart from right, 1; or"),
        ({"kind": "weak_brakes"}, "fault.0.factor: it is missing, and has no default"),
        ({"kind": "weak_brakes", "factor": 0}, "fault.0.factor: it is 0, allowed: above 0"),
    ],
)
def test_what_is_wrong_is_named(table: dict[str, Any], words: str) -> None:
    assert words in refusal(**table)


def test_the_second_table_is_told_from_the_first_by_its_line(tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    path.write_text(HEAD + '[[fault]]\nkind = "kill"\n[[fault]]\nkind = "delay"\nsamples = 1\n')
    with pytest.raises(ConfigError, match=re.escape("mission.toml:6: fault.1.samples: unknown key, did you mean")):
        read_faults(load_mission(path), [1])
    path.write_text(HEAD + '[[fault]]\nkind = "kill"\n[[fault]]\nkind = "kil"\n')
    with pytest.raises(ConfigError, match=re.escape("mission.toml:5: fault.1.kind: unknown kind 'kil', did you mean")):
        read_faults(load_mission(path), [1])


def test_a_mission_without_faults_has_none() -> None:
    assert read_faults(parse_mission(HEAD.encode(), "m.toml"), [1]) == ()


def test_a_kind_of_somebody_else() -> None:
    (table,) = read_faults(mission({"kind": "tests.faults.test_tables:Hum"}), [1])
    assert isinstance(table.made_for(1, 0, 0.05), Fault)


@pytest.mark.parametrize(
    ("table", "on", "off"),
    [
        ({}, [0.0, 1.0, 1e6], []),
        ({"start_s": 2.0}, [2.0, 3.0, 1e6], [0.0, 1.95]),
        ({"start_s": 2.0, "duration_s": 1.0}, [2.0, 2.95], [0.0, 1.95, 3.0, 12.0]),
        ({"start_s": 2.0, "duration_s": 1.0, "every_s": 10.0}, [2.0, 12.0, 22.9], [1.95, 3.0, 11.95, 13.0, 23.0]),
        ({"duration_s": 0.05, "every_s": 0.1}, [0.1 * k for k in range(50)], [0.1 * k + 0.05 for k in range(50)]),
    ],
)
def test_when_a_fault_is_on(table: dict[str, Any], on: list[float], off: list[float]) -> None:
    options = FaultOptions(kind="kill", **table)
    assert [time_s for time_s in on if not options.active(time_s)] == []
    assert [time_s for time_s in off if options.active(time_s)] == []


@pytest.mark.parametrize(
    ("where", "how"),
    [
        *product(["__init__", "widened", "spacing", "command", "sample", "impairment"], ["raises", "exits"]),
        *product(["widened", "spacing", "command", "sample", "impairment"], ["answers"]),
    ],
)
def test_a_kind_that_fails_is_named_before_anything_moves(
    monkeypatch: pytest.MonkeyPatch, where: str, how: str
) -> None:
    monkeypatch.setattr(Fails, "where", where)
    monkeypatch.setattr(Fails, "how", how)
    fault = {"kind": "tests.faults.test_tables:Fails"}
    asked = {"backend": "kinematic", "planner": "straight-line", "duration_s": 1.0, "fault": [fault]}
    mission = load_mission(ROOT / "examples" / "surveillance.toml", asked)
    said = {"raises": "RuntimeError: out of order", "exits": "SystemExit: 3"}.get(how, "'m.*allowed: a")
    for use in (run_mission, check_mission):
        with pytest.raises(ConfigError, match=rf"fault\.0\.kind: it is '.*:Fails', which failed: .*{said}"):
            use(mission)


@pytest.mark.parametrize(
    ("option", "key"), [({"commands_s": 1e7}, "latency_s"), ({"samples_s": 1e7}, "sample_age_s"),
                        ({"samples_s": 999_999.96}, "sample_age_s")]
)  # fmt: skip
def test_faults_that_nobody_could_promise_are_named(option: dict[str, float], key: str) -> None:
    asked = {"backend": "zenoh", "fault": [{"kind": "delay", **option}]}
    delayed = load_mission(ROOT / "examples" / "surveillance.toml", asked)
    with pytest.raises(ConfigError, match=rf"fault\.0\.kind: it is 'delay', which failed: .*{key}"):
        promises_of(delayed, delayed.read_workspace())


@pytest.mark.parametrize(
    ("method", "answer", "says"),
    [
        ("widened", lambda _, caps: replace(caps, latency_s=0.0), "it makes latency_s better, 0.0 in place of 0.05"),
        ("widened", lambda _, caps: replace(caps, v_max_m_s=0.1), "it makes v_max_m_s better, 0.1 in place of 0.22"),
        ("spacing", lambda _: Spacing(-1, 0), "its spacing is -1 and 0, allowed: 0 or more"),
        ("spacing", lambda _: Spacing(0, -3), "its spacing is 0 and -3"),
    ],
)
def test_a_kind_that_makes_a_promise_better_is_refused(
    monkeypatch: pytest.MonkeyPatch, method: str, answer: Callable[..., Any], says: str
) -> None:
    monkeypatch.setattr(Hum, method, answer)
    asked = {"backend": "kinematic", "fault": [{"kind": "tests.faults.test_tables:Hum"}]}
    mission = load_mission(ROOT / "examples" / "surveillance.toml", asked)
    with pytest.raises(ConfigError, match=rf"fault\.0\.kind: .* failed: ValueError: {says}"):
        promises_of(mission, mission.read_workspace())

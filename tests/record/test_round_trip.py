"""What is read from a recording is what happened, to the last bit, in forms that other tools understand."""

from __future__ import annotations

import csv
import json
import math
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from soter import __version__
from soter.record import foxglove, messages
from soter.record.attachments import RESULT_JSON
from soter.record.check import flaw, seal
from soter.record.export import export_csv, file_name
from soter.record.file import json_schema
from soter.record.looks import LOOK_S, Looks, Stall
from soter.record.messages import AC, EVENTS, ModuleTick, RobotTick
from soter.record.reader import Recording
from soter.record.samples import sample_of, state_of
from soter.record.summary import summarise
from soter.record.wire import Finish, FrameReader, RobotRow, TickFrame, Ticks, packed, tamed
from soter.replay.replay import replay
from soter.runner.trace import Trace
from soter.sdk import Controller, Link, RobotState
from tests.record.conftest import Recorded
from tests.record.helpers import every_message, mission, recorded, rewrite, zone_broken

DOUBLES = (0.1, 1.0 / 3.0, 5e-324, 1.7976931348623157e308, -0.0, math.pi, 2.0**53 + 2.0)


def test_a_recording_changes_nothing(kinematic: Recorded, tmp_path: Path) -> None:
    again = recorded(tmp_path / "again.mcap", duration_s=60.0)
    from soter.runner import run_mission

    assert again.result.trace_sha256 == run_mission(mission(duration_s=60.0)).result.trace_sha256


def test_the_trace_of_the_run_can_be_computed_from_its_recording(kinematic: Recorded) -> None:
    trace = Trace()
    ranks = {AC: -1.0, **{name: float(rank) for rank, name in enumerate(kinematic.recording.about.modules)}}
    for tick in kinematic.recording.ticks():
        if tick.robots:
            trace.add(tick.time_s, [_Seen(record, ranks) for record in tick.robots.values()])  # type: ignore[misc]
    assert trace.hexdigest() == kinematic.run.result.trace_sha256


class _Seen:
    """As much of a supervisor as a trace looks at."""

    def __init__(self, record: RobotTick, ranks: dict[str, float]) -> None:
        self.situation = self
        self.own = sample_of(record.state, record.robot_id)
        self.driver = None if record.driver == AC else self
        self.rank = ranks[record.driver]
        self.modules = [_Margin(module.margin_value) for module in record.modules]


class _Margin:
    def __init__(self, margin: float) -> None:
        self.margin = margin


def test_what_was_run_is_told(kinematic: Recorded) -> None:
    about, recording = kinematic.recording.about, kinematic.recording
    assert (about.backend, about.seed, about.base_tick_s, about.virtual_time) == ("kinematic", 4, 0.05, True)
    assert about.versions["soter-rta"] == __version__
    assert about.versions["python"] == sys.version.split()[0]
    assert [robot.robot_id for robot in about.robots] == [1, 2]
    assert about.robots[0].capabilities["v_max_m_s"] == 0.22
    assert [module.name for module in about.robots[0].modules] == list(about.modules)
    fence = about.robots[0].modules[2]
    assert (fence.unit, fence.edge_margin, fence.delta_s) == ("m", pytest.approx(0.1), 0.05)
    assert fence.horizon_reach is not None
    assert fence.horizon_reach < 0.1
    given = mission(seed=4)
    assert given.source is not None
    assert recording.attachments["mission.toml"] == Path(given.source).read_bytes()
    assert recording.attachments["workspace.xml"] == given.workspace.read_bytes()
    assert recording.workspace() == given.read_workspace()


def test_the_result_and_what_led_to_it_agree(kinematic: Recorded) -> None:
    result, content = kinematic.run.result, kinematic.recording.content()
    assert json.loads(kinematic.recording.result_json or b"") == json.loads(result.model_dump_json())
    assert not kinematic.recording.truncated
    assert Counter(each.module for each in content.disengagements) == +Counter(result.disengagements)
    ended = Counter(each.outcome for each in content.targets if each.outcome)
    assert ended == +Counter(result.targets.model_dump())
    assert len(ended) >= 2
    assert content.ticks == 6000
    assert content.violations == []
    assert content.faults[-1].affected == result.faults[0].affected > 0
    assert [goal for goal in content.goals if goal.status == "reached"]
    assert {goal.by for goal in content.goals} == {"AC", "SC"}
    assert {each.machine for each in content.transitions} >= {"TaskPlanner"}
    shares = [list(series.driver).count(0) / len(series.driver) for series in content.series.values()]
    assert sum(shares) / 2 == pytest.approx(result.ac_share, abs=1e-4)


def test_tracks_are_those_of_the_run(kinematic: Recorded) -> None:
    was, now = kinematic.run.tracks, kinematic.recording.tracks()
    assert now.drivers == was.drivers
    assert now.switches == was.switches
    assert now.safer_inset_m == pytest.approx(was.safer_inset_m)
    for robot_id, track in was.tracks.items():
        for name in ("time_s", "x_m", "y_m", "battery", "driver"):
            assert getattr(now.tracks[robot_id], name) == getattr(track, name), name


BIAS = {"kind": "bias", "x_m": 0.2, "start_s": 5.0, "every_s": 10.0, "duration_s": 0.5, "declared": False, "robot": 1}


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A run in which assumptions fail again and again."""
    path = tmp_path_factory.mktemp("recordings") / "failing.mcap"
    return Recorded(recorded(path, duration_s=40.0, fault=[BIAS]), path)


def test_every_spell_of_a_failed_assumption_is_recorded_and_they_add_up_to_the_result(failing: Recorded) -> None:
    result, recording = failing.run.result, failing.recording
    content = recording.content()
    spells = [each for each in content.breaches.values() if (each.robot_id, each.assumption) == (1, "A6")]
    assert [round(each.start_s) for each in spells] == [5, 15, 25, 35]
    assert all(each.start_s <= each.last_s <= each.start_s + 2.0 for each in spells)
    failed = {(each.robot_id, each.assumption): each for each in summarise(recording, content).assumptions}
    assert len(failed) == sum(map(len, result.assumptions.values())) >= 2
    for robot_id, by_number in result.assumptions.items():
        for number, was in by_number.items():
            now = failed[robot_id, number]
            assert (now.times, now.cause) == (was.times, was.cause)
            assert (now.first_s, now.last_s) == pytest.approx((was.first_s, was.last_s), abs=1e-6)
            assert [(each.unit, each.cause) for each in now.worst] == [(each.unit, each.cause) for each in was.worst]
            assert [each.excess for each in now.worst] == pytest.approx([each.excess for each in was.worst], abs=1e-6)


def test_a_recording_without_spells_says_what_its_result_says(failing: Recorded, tmp_path: Path) -> None:
    def older(name: str, data: bytes) -> bytes:
        if name != RESULT_JSON:
            return data
        result = json.loads(data)
        for name in ("longest_without_ac_s", "permanent_stalls", "never_moved", "accepted_unproved"):
            del result[name]
        for failed in result["assumptions"].values():
            for each in failed.values():
                del each["last_s"], each["worst"]
        return json.dumps(result).encode()

    rewrite(failing.path, tmp_path / "old.mcap", lambda topic, data: None if topic == "/breaches" else data, older)
    old = Recording(tmp_path / "old.mcap")
    summary = summarise(old, old.content())
    assert {(each.robot_id, each.assumption, each.times, each.last_s) for each in summary.assumptions} == {
        (robot, number, each.times, None)
        for robot, failed in failing.run.result.assumptions.items()
        for number, each in failed.items()
    }
    assert not summary.stalls + summary.never_moved + summary.accepted_unproved
    assert replay(old).same


def test_stalls_are_told_once_they_are_long_and_again_when_they_end() -> None:
    stalls: list[Stall] = []
    looks = Looks(stalls=lambda: stalls)
    assert list(looks.look(1.0)) == []
    stalls.append(Stall(1, 100.0, None, "obstacle", "margin 0.02 m"))
    (told,) = looks.look(400.0)
    assert told == messages.StallEvent(400.0, 1, 100.0, "obstacle", "margin 0.02 m")
    stalls[0] = replace(stalls[0], cause="another one")
    assert list(looks.look(401.0)) == []
    stalls[0] = replace(stalls[0], end_s=402.0)
    (told,) = looks.look(402.0)
    assert isinstance(told, messages.StallEvent)
    assert told.end_s == 402.0
    assert list(looks.look(403.0)) == []


def test_violations_are_recorded_while_they_happen_and_at_the_end(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run.mcap", duration_s=900.0, targets="hostile", seed=1, rta__enabled=False)
    recording = Recording(tmp_path / "run.mcap")
    content = recording.content()
    assert run.result.violations is not None
    assert Counter(each.rule for each in content.violations) == +Counter(run.result.violations)
    assert any(each.end_s is not msgspec.UNSET and each.end_s > each.start_s for each in content.violations)
    assert set(recording.tracks().violations) == set(run.tracks.violations)
    assert run.result.modules == ()
    assert content.series[1].margins == {}


def test_violations_of_a_users_own_rule_are_recorded_like_those_that_the_world_judges(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    run = zone_broken(path)
    recording = Recording(path)
    content = recording.content()
    assert run.result.violations is not None
    assert +Counter(run.result.violations) == Counter(each.rule for each in content.violations)
    assert {each.robots for each in content.violations} == {(1,), (2,)}
    assert all(0.0 < each.start_s < 120.0 for each in content.violations)
    told = [event for tick in recording.ticks() for event in tick.events if isinstance(event, messages.ViolationEvent)]
    assert told[0].time_s <= told[0].start_s + LOOK_S, "while it happens"
    assert any(each.end_s is not msgspec.UNSET and each.end_s > each.start_s for each in content.violations)
    export_csv(recording, tmp_path / "csv")
    with (tmp_path / "csv" / "violation.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["rule"] for row in rows] == [each.rule for each in told]
    assert [float(row["start_s"]) for row in rows] == [each.start_s for each in told]
    assert [row["robots"] for row in rows] == [str(*each.robots) for each in told]
    assert replay(recording).same


def test_figures_of_a_recording(kinematic: Recorded) -> None:
    summary = summarise(kinematic.recording, kinematic.recording.content())
    assert summary.duration_s == pytest.approx(300.0)
    assert summary.disengagements == {name: n for name, n in kinematic.run.result.disengagements.items() if n}
    assert summary.status == "completed"
    assert summary.ac_share == kinematic.run.result.ac_share
    assert not summary.truncated
    assert summary.violations == kinematic.run.result.violations


# --- numbers -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [*DOUBLES, math.inf, -math.inf, math.nan])
def test_every_number_comes_back_bit_by_bit(value: float) -> None:
    module = ModuleTick.of("collision", "AC", value, value)
    back = msgspec.json.decode(msgspec.json.encode(module), type=ModuleTick)
    assert value.hex() == back.margin_value.hex() == back.reach_value.hex()


def test_nothing_of_a_sample_is_left_out() -> None:
    assert {*messages.StateMessage.__struct_fields__, "robot_id"} == set(RobotState._fields)


@pytest.mark.parametrize("value", DOUBLES)
def test_a_sample_comes_back_bit_by_bit(value: float) -> None:
    for battery, controller, goal_id, vz_m_s in ((value, Controller.AC, 7, value), (None, None, None, None)):
        sample = RobotState(
            3,
            value,
            value,
            value,
            value,
            value,
            value,
            value,
            value,
            value,
            battery,
            controller,
            goal_id,
            Link.STALE,
            vz_m_s,
        )
        state = msgspec.json.decode(msgspec.json.encode(state_of(sample)), type=messages.StateMessage)
        assert repr(sample_of(state, 3)) == repr(sample)


def test_frames_come_through_a_pipe_in_any_pieces(kinematic: Recorded) -> None:
    frames = [Finish(float(number), b"x" * number, []) for number in range(20)]
    data = b"".join(packed(frame) for frame in frames)
    for size in (1, 7, 50, len(data)):
        intake = FrameReader()
        taken = [frame for at in range(0, len(data), size) for frame in intake.take(data[at : at + size])]
        assert taken == frames


def test_whatever_stands_in_a_frame_it_can_be_sent() -> None:
    foreign = (np.float64(0.1), 0.0, np.float32(0.5), np.int64(2), 0.0, 0.0, 0.0, 0.0, 0.0)
    odd = RobotState._make((1, *foreign, None, None, 2**80, Link.UP, None))
    row = RobotRow(
        odd, -1, True, 0, [math.inf, np.float64(-0.0)], unread=True, no_state="\udc80 lost", ac_failure="\ud800"
    )
    event = messages.SwitchEvent(0.0, 1, "AC", "geofence", "geofence", "cause \udcff")
    tick = TickFrame(0, 0.0, 1, [row], [(EVENTS.index(messages.SwitchEvent), event)])  # type: ignore[list-item]
    (sent,) = FrameReader().take(packed(Ticks([tick])))
    assert isinstance(sent, Ticks)
    (back,) = sent.ticks
    state = back.rows[0].state
    assert (state.stamp_s, state.x_m, state.y_m) == (0.1, 0.5, 2.0)
    assert back.rows[0].numbers == [math.inf, 0.0]
    assert back.rows[0].no_state == "\\udc80 lost"
    assert tamed({"\udc80": ["\udc81", 1.5, None]}) == {"\\udc80": ["\\udc81", 1.5, None]}


# --- checksums ---------------------------------------------------------------------------------------------


def record_of(path: Path, number: int) -> RobotTick:
    ticks = (tick for tick in Recording(path).ticks() if tick.tick == number and tick.robots)
    return next(ticks).robots[2]


def test_no_record_of_a_run_is_flawed(kinematic: Recorded) -> None:
    assert [wrong for tick in kinematic.recording.ticks() for r in tick.robots.values() if (wrong := flaw(r))] == []


@pytest.mark.parametrize("name", [name for name in messages.StateMessage.__struct_fields__ if name != "link"])
def test_a_changed_value_is_found(kinematic: Recorded, name: str) -> None:
    record = record_of(kinematic.path, 3000)
    reads: Any = "AC" if name == "controller" and record.state.controller != "AC" else "SC"
    if name != "controller":
        reads = 9999 if name == "goal_id" else 0.123
    changed = msgspec.structs.replace(record, state=msgspec.structs.replace(record.state, **{name: reads}))
    assert flaw(changed) == (150.0, 2)
    assert seal(record) == record.check


# --- schemas -----------------------------------------------------------------------------------------------


def test_every_message_follows_the_schema_that_stands_in_the_file(kinematic: Recorded) -> None:
    seen: Counter[str] = Counter()
    for _topic, name, schema, data in every_message(kinematic.path):
        seen[name] += 1
        if seen[name] <= 300:
            _check(json.loads(data), json.loads(schema), json.loads(schema))
    own = {
        messages.schema_name(kind)
        for kind in (RobotTick, messages.GoalEvent, messages.SwitchEvent, messages.TargetEvent)
    }
    drawn = {messages.schema_name(kind) for kind in foxglove.TOPICS}
    assert own | drawn <= set(seen)


def _check(value: Any, schema: Any, root: Any) -> None:
    """As much of JSON Schema as is used; also, nothing may stand there that the schema does not know."""
    if "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    kinds: dict[str, Any] = {"number": (int, float), "integer": int, "string": str, "boolean": bool}
    if schema["type"] == "object":
        assert set(schema.get("required", ())) <= set(value) <= set(schema["properties"])
        for name, inner in value.items():
            _check(inner, schema["properties"][name], root)
    elif schema["type"] == "array":
        for inner in value:
            _check(inner, schema["items"], root)
    else:
        assert isinstance(value, kinds[schema["type"]])


@pytest.mark.parametrize("kind", [RobotTick, *EVENTS, *foxglove.TOPICS])
def test_schemas_use_only_what_every_viewer_knows(kind: type[msgspec.Struct]) -> None:
    schema = json_schema(kind)
    assert schema["type"] == "object"
    assert messages.schema_name(kind).startswith(("soter.", "foxglove."))
    for part in _parts(schema):
        assert not {"anyOf", "oneOf", "allOf", "prefixItems", "additionalProperties"} & set(part)
        # A type of several, such as a number or null, is what some viewers stop at.
        assert isinstance(part.get("type", "object"), str | dict)


def _parts(schema: Any) -> Iterator[dict[str, Any]]:
    if isinstance(schema, dict):
        yield schema
        for inner in schema.values():
            yield from _parts(inner)
    elif isinstance(schema, list):
        for inner in schema:
            yield from _parts(inner)


# --- tables ------------------------------------------------------------------------------------------------


def test_tables_hold_every_message_and_every_bit(kinematic: Recorded, tmp_path: Path) -> None:
    export_csv(kinematic.recording, tmp_path / "tables")
    content = kinematic.recording.content()

    def rows(name: str) -> list[dict[str, str]]:
        with (tmp_path / "tables" / name).open(newline="") as stream:
            return list(csv.DictReader(stream))

    ticks = rows("ticks.csv")
    assert len(ticks) == 2 * 6000
    mine = [row for row in ticks if row["robot_id"] == "2"]
    assert [float(row["x_m"]) for row in mine] == list(content.series[2].x_m)
    margins = [row for row in rows("modules.csv") if row["robot_id"] == "1" and row["module"] == "collision"]
    assert [float(row["margin"]) for row in margins] == list(content.series[1].margins["collision"])
    assert len(rows(file_name(messages.SwitchEvent))) == len(content.switches)
    assert rows(file_name(messages.DropEvent)) == []


@pytest.mark.parametrize("digits", ["", "0" * 7, "f" * 8, "f" * 24, "f" * 40, "none"])
def test_a_checksum_of_another_shape_is_a_flaw(kinematic: Recorded, digits: str) -> None:
    assert flaw(msgspec.structs.replace(record_of(kinematic.path, 3000), check=digits)) == (150.0, 2)

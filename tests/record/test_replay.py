"""A replay takes every decision again: alike to the last bit, or it says when, of which robot and what."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from soter.config import load_mission
from soter.errors import ConfigError
from soter.record.attachments import ABOUT_JSON
from soter.record.messages import PeerEvent, StateMessage
from soter.record.reader import BadRecording, Recording
from soter.replay.replay import replay
from soter.report.page.html import make_page
from soter.runner import run_mission
from tests.project.source import ROOT
from tests.record.conftest import Recorded
from tests.record.helpers import SURVEILLANCE, recorded, rewrite
from tests.report.unpacked import of_page
from tests.runner.lockstep import Site


def test_a_replay_decides_the_same(kinematic: Recorded) -> None:
    found = replay(kinematic.recording)
    assert found.same
    assert (found.ticks, found.differing, found.differences, found.spells) == (6000, 0, [], [])
    assert found.before == found.after
    assert found.before.total() == kinematic.run.result.disengagements_total > 5


@pytest.mark.parametrize("name", ["gone", "late"])
def test_runs_under_faults_are_replayed_too(tmp_path: Path, name: str) -> None:
    mission = load_mission(
        ROOT / "examples" / "faults" / f"{name}.toml",
        {"backend": "kinematic", "planner": "straight-line", "duration_s": 180.0},
    )
    run_mission(mission, record=tmp_path / "run.mcap")
    found = replay(Recording(tmp_path / "run.mcap"))
    assert found.same, found.differences[:3]
    assert found.ticks == 3600


@pytest.mark.parametrize(
    "overrides",
    [
        {"rta__enabled": False},
        {"rta__modules": ["geofence"], "robots": 1},
        {"rta__path__enabled": True},
        {"robots": 1},
    ],
)
def test_other_missions_are_replayed_too(tmp_path: Path, overrides: dict[str, Any]) -> None:
    recorded(tmp_path / "run.mcap", duration_s=120.0, targets="hostile", **overrides)
    found = replay(Recording(tmp_path / "run.mcap"))
    assert found.same, found.differences[:3]


@pytest.mark.pybullet
def test_a_run_on_rigid_bodies_is_replayed_too(tmp_path: Path) -> None:
    # Nearly flat: the ways home, of which not every tick asks, count from early on.
    low = {"1": 0.3, "2": 0.2}
    recorded(tmp_path / "run.mcap", backend="pybullet", duration_s=60.0, targets="hostile", battery__initial=low)
    found = replay(Recording(tmp_path / "run.mcap"))
    assert found.same, found.differences[:3]
    assert found.ticks == 1200


def test_a_run_on_a_wall_clock_is_replayed_too(tmp_path: Path) -> None:
    pytest.importorskip("zmq")
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "soter.cli", "run", str(SURVEILLANCE), "--backend", "soter_zmq.adapter:ZmqBackend"]
    command += ["--duration", "8", "--planner", "straight-line", "--record", str(path), "--quiet"]
    done = subprocess.run(command, cwd=ROOT / "examples" / "adapter-zmq", capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    recording = Recording(path)
    assert not recording.about.virtual_time
    found = replay(recording)
    assert found.same, found.differences[:3]
    assert found.ticks == 160


def test_a_recording_that_was_cut_off_is_replayed_as_far_as_it_goes(kinematic: Recorded, tmp_path: Path) -> None:
    data, part = kinematic.path.read_bytes(), tmp_path / "part.mcap"
    part.write_bytes(data[: len(data) * 2 // 3])
    found = replay(Recording(part))
    assert found.same
    assert found.truncated
    assert 1000 < found.ticks < 6000


# --- what is changed is found ------------------------------------------------------------------------------


def changed(short: Recorded, path: Path, robot_id: int, tick: int, change: Callable[[Any], None]) -> Recording:
    """The recording with one record of one robot changed."""

    def edit(topic: str, data: bytes) -> bytes:
        if topic == f"/robots/{robot_id}/tick" and data.startswith(f'{{"tick":{tick},'.encode()):
            record = json.loads(data)
            change(record)
            return json.dumps(record).encode()
        return data

    rewrite(short.path, path, edit)
    return Recording(path)


def test_an_unchanged_copy_is_no_difference(short: Recorded, tmp_path: Path) -> None:
    rewrite(short.path, tmp_path / "copy.mcap", lambda topic, data: data)
    assert replay(Recording(tmp_path / "copy.mcap")).same


@pytest.mark.parametrize("name", ["x_m", "y_m", "heading_rad", "vx_m_s", "stamp_s", "battery", "vehicle_stamp_s"])
def test_a_flipped_bit_of_a_sample_is_found(short: Recorded, tmp_path: Path, name: str) -> None:
    def flip(record: Any) -> None:
        value = float(record["state"][name])
        record["state"][name] = _flipped(value)

    found = replay(changed(short, tmp_path / "run.mcap", 2, 1234, flip))
    assert not found.same
    (wrong,) = found.flaws
    assert wrong.time_s == pytest.approx(61.7)
    assert wrong.robot_id == 2


@pytest.mark.parametrize("name", ["margin", "reach"])
def test_a_flipped_bit_of_a_decision_is_named_twice(short: Recorded, tmp_path: Path, name: str) -> None:
    def flip(record: Any) -> None:
        record["modules"][1][name] = _flipped(record["modules"][1][name])

    found = replay(changed(short, tmp_path / "run.mcap", 1, 1000, flip))
    (difference,) = found.differences
    assert (difference.tick, difference.robot_id, difference.field) == (1000, 1, f"obstacle.{name}")
    assert float(difference.recorded) == _flipped(float(difference.replayed))
    assert [each.robot_id for each in found.flaws] == [1]


def test_a_decision_that_was_never_taken_is_named_even_with_a_right_checksum(short: Recorded, tmp_path: Path) -> None:
    from soter.record.check import seal
    from soter.record.messages import RobotTick

    def forge(record: Any) -> None:
        record["driver"] = "geofence" if record["driver"] != "geofence" else "AC"
        record["check"] = seal(msgspec.convert(record, RobotTick))

    found = replay(changed(short, tmp_path / "run.mcap", 1, 1000, forge))
    assert found.flaws == []
    (difference,) = found.differences
    assert (difference.tick, difference.robot_id, difference.field) == (1000, 1, "driver")
    assert len(found.spells) == 1


def test_a_changed_cause_and_a_missing_switch_are_named(short: Recorded, tmp_path: Path) -> None:
    first = short.recording.content().disengagements[0]
    for number, replacement in enumerate((b"margin of nothing", None)):

        def edit(topic: str, data: bytes, replacement: bytes | None = replacement) -> bytes | None:
            if topic != "/switches" or first.cause.encode() not in data:
                return data
            return replacement and data.replace(first.cause.encode(), replacement)

        path = tmp_path / f"{number}.mcap"
        rewrite(short.path, path, edit)
        found = replay(Recording(path))
        assert found.differences[0].field == "switches"
        assert found.differences[0].time_s == first.time_s
        assert first.cause in found.differences[0].replayed


def test_a_gap_ends_the_comparison(short: Recorded, tmp_path: Path) -> None:
    lost = tuple(f'{{"tick":{tick},'.encode() for tick in range(500, 510))
    rewrite(short.path, tmp_path / "run.mcap", lambda topic, data: None if data.startswith(lost) else data)
    found = replay(Recording(tmp_path / "run.mcap"))
    assert found.gap_s == pytest.approx(25.5)
    assert (found.ticks, found.same) == (500, True)


@pytest.mark.parametrize(
    ("topic", "key", "value"),
    [
        ("/robots/1/tick", "robot_id", 7),
        ("/robots/1/tick", "driver", "nobody"),
        ("/switches", "robot_id", 7),
        ("/switches", "before", "nobody"),
        ("/switches", "after", "nobody"),
        ("/targets", "robot_id", 7),
        ("/robots/1/goal", "robot_id", 7),
    ],
)
def test_what_did_not_take_part_is_damage(short: Recorded, tmp_path: Path, topic: str, key: str, value: object) -> None:
    def edit(of: str, data: bytes) -> bytes:
        return json.dumps({**json.loads(data), key: value}).encode() if of == topic else data

    rewrite(short.path, tmp_path / "run.mcap", edit)
    recording = Recording(tmp_path / "run.mcap")
    for read in (replay, Recording.content):
        with pytest.raises(BadRecording, match=f"did not take part: robot .*{value}"):
            read(recording)


def test_robots_that_are_not_in_the_workspace_are_damage(short: Recorded, tmp_path: Path) -> None:
    def change(name: str, data: bytes) -> bytes:
        if name != ABOUT_JSON:
            return data
        about = json.loads(data)
        about["robots"][0]["robot_id"] = 7
        return json.dumps(about).encode()

    rewrite(short.path, tmp_path / "run.mcap", lambda topic, data: data, change)
    with pytest.raises(BadRecording, match="its robots are 2, 7"):
        replay(Recording(tmp_path / "run.mcap"))


def test_a_lost_record_of_one_robot_is_damage(short: Recorded, tmp_path: Path) -> None:
    rewrite(
        short.path, tmp_path / "run.mcap",
        lambda topic, data: None if topic == "/robots/2/tick" and data.startswith(b'{"tick":77,') else data,
    )  # fmt: skip
    with pytest.raises(BadRecording, match="lacks a robot"):
        replay(Recording(tmp_path / "run.mcap"))


def _flipped(value: float) -> float:
    """The number with its last bit flipped."""
    word = int.from_bytes(msgspec.msgpack.encode(value)[1:], "big") ^ 1
    return msgspec.msgpack.decode(b"\xcb" + word.to_bytes(8, "big"), type=float)


# --- what if -----------------------------------------------------------------------------------------------


def test_other_settings_are_answered_in_open_loop(kinematic: Recorded) -> None:
    found = replay(kinematic.recording, {"rta.collision.delta_s": 0.1})
    # A module that looks half as often needs more of the margin, so it fires sooner, and where it did not at all.
    assert found.after["collision"] > found.before["collision"]
    assert found.before["collision"] == kinematic.run.result.disengagements["collision"]
    assert found.spells
    assert all(spell.end_s > spell.start_s and spell.recorded != spell.replayed for spell in found.spells)
    assert found.after["supervisor"] == 0
    assert found.ill_formed == []


def test_the_same_settings_change_nothing(kinematic: Recorded) -> None:
    found = replay(kinematic.recording, {"rta.geofence.delta_s": 0.05})
    assert (found.spells, found.differing) == ([], 0)


def test_settings_that_a_run_would_refuse_are_answered_with_a_word(kinematic: Recorded) -> None:
    found = replay(kinematic.recording, {"rta.collision.delta_s": 0.4})
    # The robots have promises of their own: robot 2 loses commands.
    assert len(found.ill_formed) == 2
    assert all("module 'collision' is ill-formed (P3)" in refusal for refusal in found.ill_formed)
    assert found.spells


def test_a_module_that_is_switched_off_decides_nothing(kinematic: Recorded) -> None:
    found = replay(kinematic.recording, {"rta.modules": ["collision", "obstacle", "battery"]})
    assert found.before["geofence"] > 0
    assert found.after["geofence"] == 0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"seed": 3}, "only keys below rta and battery"),
        ({"rta.colision.delta_s": 0.1}, "did you mean 'collision'?"),
        ({"rta.collision.delta_s": 0.12}, "a multiple of base_tick_s"),
    ],
)
def test_settings_that_mean_nothing_are_refused(kinematic: Recorded, settings: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        replay(kinematic.recording, settings)
    assert words in str(refused.value)


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recordings of two processes, a robot each, that were cut off from each other for a while."""
    folder = tmp_path_factory.mktemp("apart")
    processes = {"alpha": ((1,), False), "beta": ((2,), True)}
    site = Site(processes, record=folder, targets="hostile", duration_s=40.0)
    try:
        site.start("alpha")
        site.start("beta", 0.313)
        site.at(15.0, lambda: site.network.isolate("alpha", ["beta"]))
        site.at(25.0, lambda: site.network.cut.clear())
        site.run(45.0)
    finally:
        site.close()
    return folder


@pytest.mark.parametrize("process", ["alpha", "beta"])
def test_a_process_of_a_distributed_mission_is_replayed_with_what_it_heard(apart: Path, process: str) -> None:
    recording = Recording(apart / f"{process}.mcap")
    found = replay(recording)
    assert found.same, found.differences[:3]
    assert found.ticks == 800
    heard = [event for tick in recording.ticks() for event in tick.events if isinstance(event, PeerEvent)]
    assert len(heard) == 800
    silent = [
        each for each in heard if not isinstance(each.state, StateMessage) or each.time_s - each.state.stamp_s > 0.5
    ]
    assert len(silent) > 150, "they were cut off for ten seconds"


def test_a_process_that_gives_targets_to_the_robots_of_others_has_a_page(apart: Path) -> None:
    recording = Recording(apart / "beta.mcap")
    assert {target.robot_id for target in recording.content().targets} == {1, 2}
    document = of_page(make_page(recording)).document
    assert document["summary"]["elsewhere"] == [1]
    (robot,) = document["robots"]
    own = [each.target_id for each in recording.content().targets if each.robot_id == 2 and not each.outcome]
    assert [number for number, *_ in robot["targets"]["rows"]] == own


def test_a_flipped_bit_of_what_was_heard_of_a_peer_is_found(apart: Path, tmp_path: Path) -> None:
    seen = 0

    def edit(topic: str, data: bytes) -> bytes:
        nonlocal seen
        if topic == "/peers" and (seen := seen + 1) == 700:
            record = json.loads(data)
            record["state"]["y_m"] = _flipped(record["state"]["y_m"])
            return json.dumps(record).encode()
        return data

    rewrite(apart / "alpha.mcap", tmp_path / "run.mcap", edit)
    assert [each.robot_id for each in replay(Recording(tmp_path / "run.mcap")).flaws] == [2]

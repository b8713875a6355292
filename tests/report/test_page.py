"""The page of a recording: what is in it, that it is exact where it says so, and that it loads nothing."""

from __future__ import annotations

import re
from html import escape
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

from soter.campaign.report.beside import make_beside
from soter.record.content import Content, RecordedTick
from soter.record.messages import BreachEvent, DropEvent, Event, StallEvent, WorstMessage
from soter.record.reader import Recording
from soter.report.page import extract
from soter.report.page.html import make_page
from tests.record.helpers import recorded, rewrite, standing, zone_broken
from tests.report.unpacked import Unpacked, of_page

DURATION_S = 120.0


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two minutes in which a lot happens."""
    path = tmp_path_factory.mktemp("pages") / "run.mcap"
    recorded(path, duration_s=DURATION_S, seed=4, targets="hostile")
    return path


@pytest.fixture(scope="module")
def content(path: Path) -> Content:
    return Recording(path).content()


@pytest.fixture(scope="module")
def page(path: Path) -> str:
    return make_page(Recording(path))


@pytest.fixture(scope="module")
def data(page: str) -> Unpacked:
    return of_page(page)


def without_result(path: Path, target: Path) -> Path:
    """The recording as it is when its run was killed: cut off in the middle of the last chunk but some."""
    whole = path.read_bytes()
    target.write_bytes(whole[: len(whole) * 2 // 3])
    return target


# --- what is in it -----------------------------------------------------------------------------------------


def test_the_page_loads_nothing(page: str) -> None:
    assert "default-src 'none'" in page
    assert re.findall(r"""(?:src|href)=["'](?!#|data:)|url\(|@import|\bfetch\(|https?://(?!www\.w3)""", page) == []


def test_poses_are_those_of_the_recording(data: Unpacked, content: Content) -> None:
    for robot in data.document["robots"]:
        series, poses = content.series[robot["id"]], robot["poses"]
        assert data.column(poses["timeS"]) == pytest.approx(np.asarray(series.time_s), abs=1e-3)
        assert data.column(poses["xM"]) == pytest.approx(np.asarray(series.x_m), abs=1e-3)
        assert data.column(poses["yM"]) == pytest.approx(np.asarray(series.y_m), abs=1e-3)
        turned = data.column(poses["headingRad"]) - np.asarray(series.heading_rad)
        assert np.cos(turned) == pytest.approx(np.ones(len(turned)), abs=1e-5)


def test_margins_are_those_of_the_recording(data: Unpacked, content: Content) -> None:
    for robot in data.document["robots"]:
        for module in robot["modules"]:
            margins = content.series[robot["id"]].margins[module["name"]]
            assert data.column(module["low"]) == pytest.approx(np.asarray(margins), abs=1e-4)
            assert (data.column(module["low"]) <= data.column(module["high"]) + 1e-9).all()


def test_the_title_says_how_long_the_run_lasted(page: str, data: Unpacked) -> None:
    title = "surveillance: 2 robots, 2 min on kinematic"
    assert data.document["title"] == title
    assert f"<title>{title}</title>" in page


def test_who_drove_is_exact(data: Unpacked, content: Content) -> None:
    for robot in data.document["robots"]:
        series = content.series[robot["id"]]
        again: list[int] = []
        stretches = [*robot["stretches"]["rows"], [float("inf"), None]]
        for (start_s, driver), (end_s, _) in pairwise(stretches):
            again += [driver for time_s in series.time_s if start_s <= time_s < end_s]
        assert again == list(series.driver)


def test_every_switch_has_its_cause(data: Unpacked, content: Content) -> None:
    rows = data.document["switches"]["rows"]
    assert [(time_s, robot, module, cause) for time_s, robot, _, _, module, cause, _ in rows] == [
        (each.time_s, each.robot_id, each.module, each.cause) for each in content.switches
    ]
    assert len([1 for _, _, before, after, *_ in rows if before == 0 and after != 0]) == len(content.disengagements) > 3


def test_targets_and_goals_have_begin_and_end(data: Unpacked, content: Content) -> None:
    targets = [target for robot in data.document["robots"] for target in robot["targets"]["rows"]]
    assert len(targets) == len([each for each in content.targets if not each.outcome])
    assert {outcome for *_, outcome in targets} - {""} == {each.outcome for each in content.targets} - {""}
    for robot in data.document["robots"]:
        begins, ends = (data.column(robot["goals"][name]) for name in ("beginS", "endS"))
        assert len(begins) == len([
            each for each in content.goals if each.robot_id == robot["id"] and each.status == "active"
        ])  # fmt: skip
        assert (ends >= begins).all()
        assert (begins[1:] >= ends[:-1] - 1e-9).all()


def test_ways_are_those_that_were_meant(data: Unpacked, content: Content) -> None:
    ways = content.ways
    assert ways
    for robot in data.document["robots"]:
        mine = [(time_s, places) for time_s, robot_id, places in ways if robot_id == robot["id"]]
        begins = data.column(robot["ways"]["begin"]).astype(int)
        xs_m, ys_m = data.column(robot["ways"]["xM"]), data.column(robot["ways"]["yM"])
        for index, (_, places) in enumerate(mine):
            found = [(xs_m[at], ys_m[at]) for at in range(begins[index], begins[index + 1])]
            assert np.asarray(found) == pytest.approx(np.asarray(places), abs=1e-3)


# --- thinning out ------------------------------------------------------------------------------------------


def test_a_long_run_is_thinned_out_and_says_so(path: Path, content: Content, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extract, "MOST_POSES", 400)
    monkeypatch.setattr(extract, "MOST_BUCKETS", 50)
    thin = of_page(make_page(Recording(path)))
    assert thin.document["thinned"] == {"tickS": 0.05, "poseTicks": 12, "bucketTicks": 48}
    for robot in thin.document["robots"]:
        series = content.series[robot["id"]]
        times_s = thin.column(robot["poses"]["timeS"])
        assert len(times_s) <= 202
        assert times_s[-1] == pytest.approx(series.time_s[-1])
        for module in robot["modules"]:
            low = thin.column(module["low"])
            assert len(low) == 50
            assert low.min() == pytest.approx(min(series.margins[module["name"]]), abs=1e-4)
    assert len(thin.document["switches"]["rows"]) == len(content.switches)


# --- what ground truth said --------------------------------------------------------------------------------


def test_truth_is_known_to_the_end(data: Unpacked, path: Path) -> None:
    truth = data.document["truth"]
    result = Recording(path).result
    assert result is not None
    assert truth["known"] == "yes"
    assert truth["counts"] == result.violations
    assert data.document["summary"]["traceSha256"] == result.trace_sha256


def test_violations_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    run = recorded(path, duration_s=DURATION_S, targets="hostile", rta__enabled=False)
    assert run.result.violated
    truth = of_page(make_page(Recording(path))).document["truth"]
    assert truth["counts"] == run.result.violations
    assert {rule for rule, *_ in truth["violations"]} == {rule for rule, count in truth["counts"].items() if count}


def test_violations_of_a_users_own_rule_are_listed_with_robot_and_time(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    run = zone_broken(path)
    truth = of_page(make_page(Recording(path))).document["truth"]
    assert truth["counts"] == run.result.violations
    assert [rule for rule, *_ in truth["violations"]] == ["zone-speed"] * truth["counts"]["zone-speed"]
    starts = [start_s for _, _, start_s, _ in truth["violations"]]
    assert all(0.0 < start_s < DURATION_S for start_s in starts)
    assert {robot for _, robots, *_ in truth["violations"] for robot in robots} == {1, 2}


def test_failed_assumptions_and_stalls_are_listed_with_their_times(path: Path, tmp_path: Path) -> None:
    worst = WorstMessage(0.045, "of a charge", 61.0, "'battery': margin -0.045")
    told: list[Event] = [
        BreachEvent(30.0, 1, "A14", 29.5, 30.0, 11, "'battery': margin -0.001"),
        BreachEvent(62.0, 1, "A14", 29.5, 61.5, 600, "'battery': margin -0.001", (worst,)),
        BreachEvent(90.0, 2, "A7", 89.0, 89.0, 1, "robot 1: not heard of for 0.550 s"),
        StallEvent(100.0, 1, 40.0, "obstacle", "margin 0.02 m"),
        StallEvent(110.0, 2, 50.0, "battery", "start", 109.0),
    ]
    recording = Recording(path)
    whole = recording.content

    def with_trouble(self: Recording) -> Content:
        content = whole()
        content.add(RecordedTick(0, 0.0, 0, {}, tuple(told)))
        return content

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Recording, "content", with_trouble)
        document = of_page(make_page(recording)).document
    assert document["breaches"]["rows"] == [
        [1, "A14", 29.5, 61.5, 600, "'battery': margin -0.001", [[0.045, "of a charge", 61.0, worst.cause]]],
        [2, "A7", 89.0, 89.0, 1, "robot 1: not heard of for 0.550 s", []],
    ]
    assert document["stalls"]["rows"] == [
        [1, 40.0, None, "obstacle", "margin 0.02 m"], [2, 50.0, 109.0, "battery", "start"],
    ]  # fmt: skip


def test_robots_that_stood_for_good_and_never_moved_are_named(data: Unpacked, tmp_path: Path) -> None:
    result = standing(tmp_path / "run.mcap").result
    document = of_page(make_page(Recording(tmp_path / "run.mcap"))).document
    # Without an end: the time line has them hatched up to its own.
    assert [row[:4] for row in document["stalls"]["rows"]] == [
        [robot, stall.since_s, None, stall.module] for robot, stall in result.permanent_stalls.items()
    ]
    assert document["summary"]["neverMoved"] == [*result.never_moved] == [1, 2]
    assert data.document["summary"]["neverMoved"] == data.document["stalls"]["rows"] == []


def test_a_recording_that_was_cut_off_does_not_claim_to_be_safe(path: Path, tmp_path: Path) -> None:
    cut = Recording(without_result(path, tmp_path / "cut.mcap"))
    document = of_page(make_page(cut)).document
    assert document["truth"]["known"] == "not summed up"
    assert document["summary"]["truncated"]
    assert 0.0 < document["lastS"] < DURATION_S - 1.0
    assert document["summary"]["status"] is None


def test_a_recording_that_ended_before_its_first_tick_has_a_page(path: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:20_000])
    document = of_page(make_page(Recording(cut))).document
    assert (document["summary"]["ticks"], document["lastS"], document["truth"]["known"]) == (0, 0.0, "not summed up")


def test_gaps_are_said(path: Path, tmp_path: Path) -> None:
    gap = DropEvent(time_s=60.0, first_tick=1200, ticks=40)
    target = tmp_path / "gap.mcap"
    rewrite(path, target, lambda topic, message: None if in_gap(message) else message)
    recording = Recording(target)
    whole = recording.content
    with pytest.MonkeyPatch.context() as patch:
        # The gap itself is said by the writer; here it is said for it.
        patch.setattr(Recording, "content", lambda self: with_drop(whole(), gap))
        document = of_page(make_page(recording)).document
    assert document["drops"]["rows"] == [[60.0, 1200, 40]]
    assert document["summary"]["droppedTicks"] == 40


def in_gap(message: bytes) -> bool:
    """Whether a message is a tick from 1200 on, for 40 ticks."""
    found = re.match(rb'{"tick":(\d+),', message)
    return found is not None and 1200 <= int(found[1]) < 1240


def with_drop(content: Content, drop: DropEvent) -> Content:
    content.drops.append(drop)
    return content


def test_a_backend_without_truth_is_not_called_safe(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording(path)
    assert recording.result is not None
    result = msgspec.structs.replace(recording.result, violations=None, min_margin=None)
    monkeypatch.setattr(Recording, "result", property(lambda _: result))
    truth = of_page(make_page(recording)).document["truth"]
    assert (truth["known"], truth["margins"]) == ("no", {})


# --- what is foreign ---------------------------------------------------------------------------------------


def test_names_of_a_recording_are_no_markup(path: Path, tmp_path: Path) -> None:
    evil = "</script><script>alert(1)</script>.toml"
    target = tmp_path / "evil.mcap"
    rewrite(path, target, lambda topic, message: message)
    recording = Recording(target)
    recording.about.source = evil
    page = make_page(recording)
    assert evil not in page
    assert "<title>script&gt;" in page or escape("script>") in page
    assert of_page(page).document["summary"]["mission"] == evil


# --- without modules ---------------------------------------------------------------------------------------


def test_a_run_without_modules_has_the_margins_that_ground_truth_goes_by(tmp_path: Path) -> None:
    done = recorded(tmp_path / "run.mcap", duration_s=60.0, targets="hostile", rta__enabled=False)
    data = of_page(make_page(Recording(tmp_path / "run.mcap")))
    least = {
        module["name"]: min(
            float(np.min(data.column(robot["modules"][index]["low"]))) for robot in data.document["robots"]
        )
        for index, module in enumerate(data.document["robots"][0]["modules"])
    }
    truth = done.result.min_margin
    assert truth is not None
    assert set(least) == set(truth) - {"battery"}
    for rule, margin in least.items():
        # Between two ticks a robot drives a few centimetres, which the truth sees.
        assert truth[rule] - 1e-3 <= margin <= truth[rule] + 0.03, rule
    assert min(least.values()) < 0.0


# --- beside each other --------------------------------------------------------------------------------------


def test_recordings_beside_each_other_are_told_in_words_with_all_their_rules(tmp_path: Path) -> None:
    recorded(tmp_path / "mission.mcap", duration_s=2.0)
    recorded(tmp_path / "driven.mcap", duration_s=2.0, ac="adversary:chase")
    page = make_beside([Recording(tmp_path / f"{name}.mcap") for name in ("mission", "driven")])
    cells = re.findall(r"<tr><td>(.*?)</td><td>(.*?)</td><td>(.*?)</td></tr>", page)
    table = {name: (one, other) for name, one, other in cells}
    assert not [name for name in table if "_" in name or "." in name]
    assert table["duration"] == ("2 s", "2 s")
    assert table["advanced controller"] == ("mission surveillance", "adversary:chase")
    assert table["targets reached"] == ("0", "-")
    assert all(each.endswith(" m") for each in table["least margin: geofence"])
    assert all(each.endswith(" %") for each in (*table["least margin: battery"], *table["AC in control"]))

"""Rules of a user's own among those of the world, and margins of theirs that are no numbers."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import pytest

from soter.campaign.conditions import Condition
from soter.campaign.job import Done
from soter.campaign.report.beside import make_beside
from soter.cli.summary import caption, rows
from soter.config import load_mission
from soter.interactive import FinishedRun
from soter.report.page.html import make_page
from soter.runner import Run, run_mission
from soter.runner.progress import Follower
from soter.runner.result import RunResult
from soter.sdk import RULES
from tests.record.helpers import QUICK, SURVEILLANCE, ZONE
from tests.report.unpacked import of_page

FAILS = {
    "is not a number": 'return float("nan")',
    "raises": 'raise RuntimeError("the rule failed")',
}
DRIVEN = """
        if situation.now_s >= 2.5 and hypot(own.vx_m_s, own.vy_m_s) > 0.01:
            MOVED.append(own)
        if own.robot_id == 2 and MOVED:
            {fails}
"""
"""From when on robots have driven, which admission does not see: it asks of robots at rest."""


def failing(folder: Path, how: str, *, enabled: bool, follower: Follower | None = None) -> Run:
    """Record a run of the zone in the midst of which the margin of robot 2 fails; no rule is broken otherwise."""
    own = "        own = situation.own\n"
    text = ZONE.with_name("zone_speed.py").read_text()
    assert text.count(own) == 1
    text = text.replace(own, own + DRIVEN.format(fails=FAILS[how]))
    (folder / "zone_speed.py").write_text(f"{text}\n\nMOVED = []\n")
    mission = folder / "zone.toml"
    mission.write_text(ZONE.read_text().replace("../surveillance.xml", str(SURVEILLANCE.with_suffix(".xml"))))
    settings: dict[str, Any] = {
        **QUICK, "duration_s": 60.0, "rta.module.zone-speed.enabled": enabled,
        "rta.module.zone-speed.options.limit_m_s": 0.3,  # faster than any robot is
    }  # fmt: skip
    loaded = load_mission(mission, settings)
    return run_mission(loaded, record=folder / "run.mcap", follower=follower or Follower(), accept_unproved=True)


@pytest.mark.parametrize("how", FAILS)
@pytest.mark.parametrize("enabled", [True, False], ids=["with the module", "without"])
def test_a_margin_that_fails_in_mid_run_is_a_violation_that_is_told_of(
    tmp_path: Path, how: str, enabled: bool, caplog: pytest.LogCaptureFixture
) -> None:
    run = failing(tmp_path, how, enabled=enabled)
    assert run.result.violations == {**dict.fromkeys(RULES, 0), "zone-speed": 1}
    told = [record.getMessage() for record in caplog.records]
    assert not [text for text in told if "a watch failed" in text]
    read = FinishedRun.read(tmp_path / "run.mcap")
    assert read.result == run.result
    content = read.recording.content()
    (violation,) = content.violations
    taken = [each.time_s for each in content.disengagements if (each.robot_id, each.module) == (2, "zone-speed")]
    assert taken == [pytest.approx(violation.start_s, abs=0.2)] * enabled
    assert (violation.rule, violation.robots, violation.end_s) == ("zone-speed", (2,), msgspec.UNSET)
    assert 2.5 <= violation.start_s < 5.0
    first = f"'zone-speed' is not a number, first of robot 2 at {violation.start_s:.2f} s; that counts as a violation"
    assert [text for text in told if "number" in text] == [f"the margin of {first}"]
    for result in (run.result, read.result):
        assert result.min_margin is not None
        assert math.isnan(result.min_margin["zone-speed"])
        assert result.min_margin["geofence"] > 0.0
        shown = {row.name.strip(): row.value for row in rows(result)[0]}
        assert shown["zone-speed"] == "1, least margin not a number"
        assert {rule.name: rule.margin for rule in caption(result, 0.3).rules}["zone-speed"] == "NaN"
    truth = of_page(make_page(read.recording)).document["truth"]
    assert (truth["margins"]["zone-speed"], truth["counts"]["zone-speed"]) == (None, 1)
    assert make_beside([read.recording]).count("<td>not a number</td>") == 1


def test_a_margin_that_is_not_a_number_is_followed_as_the_least_of_all(tmp_path: Path) -> None:
    run = failing(tmp_path, "is not a number", enabled=False, follower=Follower(falls_of="zone-speed"))
    *before, (last_s, last) = run.falls
    assert last == -math.inf
    assert before
    assert all(margin >= 0.0 for _, margin in before)
    (violation,) = FinishedRun.read(tmp_path / "run.mcap").recording.content().violations
    assert last_s == pytest.approx(violation.start_s)


def test_a_campaign_has_no_least_margin_of_what_was_not_a_number(tmp_path: Path) -> None:
    done = Done.of(failing(tmp_path, "is not a number", enabled=False))
    assert done.result is not None
    assert done.result["min_margin"]["zone-speed"] is None
    row: Any = type("Row", (), {"id": "a", "status": "done", "findings": [], "result": done.result})
    required = {"min_margin >= 0": False, "min_margin.zone-speed >= 0": False, "min_margin.geofence >= 0": True}
    assert {text: Condition.parse(text).judge([row]).holds for text in required} == required


def test_margins_that_json_cannot_hold_come_back() -> None:
    result = run_mission(load_mission(SURVEILLANCE, {**QUICK, "duration_s": 1.0})).result
    margins = {"geofence": 0.5, "far": math.inf, "odd": math.nan}
    odd = result.model_copy(update={"min_margin": margins, "violations": {"geofence": 0, "far": 0, "odd": 1}})
    assert RunResult.model_validate_json(odd.model_dump_json()) == odd


def test_every_violation_of_the_world_and_of_users_rules_is_recorded_once(tmp_path: Path) -> None:
    settings = {**QUICK, "duration_s": 240.0, "targets": "hostile", "rta.enabled": False}
    run = run_mission(load_mission(ZONE, settings), record=tmp_path / "run.mcap", accept_unproved=True)
    content = FinishedRun.read(tmp_path / "run.mcap").recording.content()
    assert run.result.violations is not None
    counted = Counter(each.rule for each in content.violations)
    assert counted == +Counter(run.result.violations)
    assert counted.keys() > {"zone-speed"}

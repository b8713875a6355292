"""Configurations that were once accepted and went wrong: each is refused with the reason, or runs as it should.

The folder `cases` has them as small files, one for each class; where one is found that has no like here, it is added.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from soter.campaign.job import JUDGED, Done, Job, carry_out
from soter.campaign.random.configuration import Configuration
from soter.campaign.random.room import Patch, patch_of

CASES = sorted((Path(__file__).parent / "cases").glob("*.toml"))

REFUSED = {
    "adding-up": r"'collision' .*\(P2a\): .* 0\.079 m long, more than a quarter of the separation of 0\.3 m",
    "behind-own-rule": r"'battery' .*\(P2b\): .* no place can be reached where .* the mission's own rules give a robot",
    "closed-half": r"P2b of module 'collision' is PARTLY: 2 places are found for 2 robots",
    "fine-ticks": r"base_tick_s: it is 0\.01, .* allowed: a multiple of 0\.05",
    "noisy": r"'collision' .*\(P3\): .* fall by 0\.114 m and be wrong by 0\.200 m, .* it is only 0\.200 m",
    "pocket": r"'battery' .*\(P3\): .* 25\.6\d* of a charge is kept",
    "pushed-off": r"'battery' .*\(P3\): .* 2\.61\d* of a charge is kept",
    "too-close": r"rta\.collision\.phi_safe_m: it is 0\.19, but two bodies .* overlap at less than 0\.21 m",
}
"""The reasons of those cases that are refused; the others run."""

STUCK_S = 100.0
"""Cases are short: a robot that is in SC for so long, without charging, was there for good."""


@pytest.fixture(autouse=True)
def _few_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    # With fewer trials of users' modules more is accepted, and all that is accepted has to run as it should.
    monkeypatch.setattr("soter.check.mission.BUDGET", 10)


def judged(case: Path) -> Done:
    return carry_out(Job("cases", 0, str(case), {}, {}, judged=True), lambda: False)


def assert_safe(done: Done) -> None:
    assert (done.status, done.failure, done.findings) == ("done", "", [])
    assert done.result is not None
    assert max(done.result[JUDGED]["in_sc_s"].values()) <= STUCK_S


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
@pytest.mark.long
def test_a_case_is_refused_for_its_reason_or_runs_without_a_violation_and_a_stall(case: Path) -> None:
    done = judged(case)
    if (why := REFUSED.get(case.stem)) is None:
        assert_safe(done)
    else:
        assert done.status == "refused"
        assert re.search(why, done.failure)


def test_cases_with_enough_room_are_accepted(tmp_path: Path) -> None:
    # What is like a case, but for what is wrong with it, must not be refused along with it.
    for name, wider_m in (("corridor", 0.45), ("bent-corridor", 0.45)):
        case = Configuration.read(CASES[0].parent / f"{name}.toml")
        boxes = []
        for box in filter(None, map(patch_of, case.room.boxes)):
            # Every box gives way on the side that faces the corridor.
            low_x = box.low_x + wider_m if name == "bent-corridor" and box.low_x > 4.9 else box.low_x
            low_y = box.low_y + wider_m if box.low_y > 1.0 else box.low_y
            high_y = box.high_y - wider_m if box.low_y == 0.0 and name == "corridor" else box.high_y
            boxes.append(replace(box, low_x=low_x, low_y=low_y, high_y=high_y).ring)
        assert_safe(judged(replace(case, room=replace(case.room, boxes=tuple(boxes))).write(tmp_path / name)))
    roomy = Configuration.read(CASES[0].parent / "narrow-1020.toml")
    wider = Patch(0.0, 0.0, 1.6, max(y for _, y in roomy.room.fence))
    assert_safe(judged(replace(roomy, room=replace(roomy.room, fence=wider.ring)).write(tmp_path / "roomy")))


def test_a_robot_that_another_ones_station_may_shut_in_waits_there_for_as_long_as_its_reserve_pays_for(
    tmp_path: Path,
) -> None:
    pocket = CASES[0].parent / "pocket.toml"
    shutil.copy(pocket.with_suffix(".xml"), tmp_path)

    def charged_in(charge_s: float) -> Done:
        text = pocket.read_text().replace("charge_s = 36000.0", f"charge_s = {charge_s}")
        # Robot 1 has to get past robot 2 while that one charges.
        text = text.replace("1 = 1.0", "1 = 0.4").replace("2 = 0.6", "2 = 0.3").replace("3600.0", "900.0")
        case = tmp_path / "case.toml"
        case.write_text(text)
        return judged(case)

    assert_safe(charged_in(100.0))
    slow = charged_in(2000.0)
    assert slow.status == "refused"
    assert (
        "a smaller battery.charge_s, for which the robot waits where 1 occupied station may shut it in" in slow.failure
    )

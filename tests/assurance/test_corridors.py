"""The campaign of corridors and small rooms has all that it is to have, and each room holds for a moment."""

from __future__ import annotations

import tomllib
from typing import Any, Final

from soter.campaign.job import Job, carry_out
from soter.controllers import ADVERSARIES, PREFIX
from tests.project.source import ROOT

PATH: Final = ROOT / "examples" / "campaigns" / "corridors.toml"
PART: Final[dict[str, Any]] = tomllib.loads(PATH.read_text())["part"][0]
ADVERSE: Final = [f"{PREFIX}{adversary}" for adversary in ADVERSARIES]
SHORT_S: Final = 3.0


def test_a_hundred_set_ups_meet_every_adversary() -> None:
    grid = PART["grid"]
    rooms = {str(room.relative_to(PATH.parents[1])) for room in PATH.with_suffix("").glob("*.toml")}
    assert set(grid["workspace"]) == rooms
    assert grid["robots"] == [1, 2, 3, 4, 5, 6]
    assert len(rooms) * len(grid["robots"]) >= 100
    assert set(grid["ac"]) == {"mission", *ADVERSE}


def test_every_room_is_accepted_and_keeps_its_rules_for_a_moment() -> None:
    mission = str(PATH.parent / "../surveillance.toml")
    for index, room in enumerate(PART["grid"]["workspace"]):
        # Some number of robots, and some adversary.
        settings = {"workspace": room, "robots": 1 + index % 6, "ac": ADVERSE[index % len(ADVERSE)], "seed": 1}
        job = Job("corridors", 0, mission, {**PART["set"], **settings, "duration_s": SHORT_S}, {})
        done = carry_out(job, lambda: False)
        assert (room, done.status, done.failure) == (room, "done", "")
        assert done.result is not None
        assert not any(done.result["violations"].values()), room

"""What is said at the end of a run."""

from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from soter.cli.summary import caption, differences, headline, outcome, per_robot_hour, print_summary, remarks, rows
from soter.runner import RunResult, TickTimes
from soter.runner.result import BreachFigures, StallFigures, WorstFigures

THESIS_LIKE = {"duration_s": 7200.0, "robots": 2, "targets_from": "grid"}


def made(result: RunResult, **changes: object) -> RunResult:
    """A result that differs in some figures."""
    return result.model_copy(update=changes)


def values(result: RunResult) -> dict[str, tuple[str, str]]:
    """Value and thesis's value by name."""
    return {row.name.strip(): (row.value, row.thesis) for block in rows(result) for row in block}


def printed(result: RunResult, width: int = 80, *, compared: bool = False) -> str:
    """The summary as it goes into a file."""
    file = io.StringIO()
    print_summary(Console(file=file, width=width), result, compared=compared)
    return file.getvalue()


def test_a_run_like_the_thesiss_is_compared_in_totals(result: RunResult) -> None:
    like = made(result, **THESIS_LIKE, disengagements_total=700)
    assert differences(like) == []
    assert values(like)["disengagements"] == ("700", "313")
    assert values(like)["per robot-hour"] == ("175", "78")
    assert not any("thesis" in remark for remark in remarks(like, compared=True))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"duration_s": 600.0}, "10 min instead of 2 h"),
        ({"robots": 1}, "1 robot instead of 2"),
        ({"robots": 6}, "6 robots instead of 2"),
        ({"targets_from": "hostile"}, "hostile targets instead of grid"),
        ({"modules": ()}, "no modules instead of all four"),
        ({"modules": ("battery",)}, "battery module instead of all four"),
    ],
)
def test_what_differs_from_the_thesis_is_said(result: RunResult, changes: dict[str, object], said: str) -> None:
    other = made(result, **{**THESIS_LIKE, **changes})
    assert differences(other) == [said]
    assert values(other)["disengagements"][1] == ""
    assert values(other)["per robot-hour"][1] == "78"
    assert f"Not the thesis's run ({said})" in printed(other, 300, compared=True)
    assert "thesis" not in printed(other, 300)


def test_rates() -> None:
    assert per_robot_hour(313, 2, 7200.0) == 78.25
    assert math.isnan(per_robot_hour(0, 2, 0.0))


def test_violations_are_listed_by_rule_with_their_margins(result: RunResult) -> None:
    shown = values(made(result, violations={"geofence": 3, "battery": 0}, contacts=2))
    assert shown["violations"] == ("3", "0")
    assert shown["contacts"] == ("2", "")
    block = {row.name.strip(): row.value for row in rows(made(
        result, violations=dict.fromkeys(("collision", "battery", "geofence", "obstacle"), 0),
        min_margin={"collision": -0.0904, "battery": 0.171, "geofence": math.inf, "obstacle": -0.0001},
    ))[0]}  # fmt: skip
    assert block["collision"] == "0, least margin -0.090 m"
    assert block["battery"] == "0, least margin 17.1 %"
    assert block["geofence"] == "0"
    assert block["obstacle"] == "0, least margin 0.000 m"
    hardly = made(result, violations={"obstacle": 1}, min_margin={"obstacle": -0.0})
    assert "1, least margin < 0 m" in [row.value for row in rows(hardly)[0]]


def test_without_truth_violations_are_unknown(result: RunResult) -> None:
    blind = made(result, violations=None, min_margin=None, contacts=None)
    assert values(blind)["violations"][0] == "unknown: there is no ground truth"
    assert caption(blind, 0.85).figures[-1] == "violations unknown"
    assert caption(blind, 0.85).rules == ()


def test_what_truth_did_not_see_is_unknown(result: RunResult) -> None:
    shown = values(made(result, violations={"geofence": 0}, truth_ended_s=12.3))
    assert shown["violations"][0] == "0 up to 12.3 s, unknown since then"


def test_on_a_wall_clock_it_says_how_late_ticks_came(result: RunResult) -> None:
    shown = values(made(result, tick_late_ms=TickTimes(p50=0.11, p99=2.0, max=31.25)))
    assert shown["ticks late by"][0] == "p50 0.1 ms, p99 2.0 ms, max 31.2 ms"


@pytest.mark.parametrize(("answered", "shown"), [(None, False), (1.0, False), (0.85, False), (0.442, True)])
def test_a_mission_that_answers_few_ticks_is_named(result: RunResult, answered: float | None, shown: bool) -> None:
    rows = values(made(result, answered=answered))
    assert ("ticks answered" in rows) is shown
    assert not shown or "44.2 %" in rows["ticks answered"][0]


def test_disengagements_are_listed_by_module_with_the_needless(result: RunResult) -> None:
    shown = values(made(
        result, disengagements={"geofence": 4, "collision": 1}, joined={"collision": 2}, disengagements_total=5,
        needless=2,
    ))  # fmt: skip
    assert shown["geofence"][0] == "4"
    assert shown["collision"][0] == "1, joined 2 more"
    assert shown["needless"][0] == "2"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "completed"),
        ({"violations": {"battery": 1}}, "completed, with violations"),
        ({"failed_robots": {1: "it raised", 2: "it raised"}}, "completed, but no robot has its AC any more"),
        ({"status": "interrupted", "duration_s": 90.0}, "interrupted after 90 s; the robots are stopped"),
        ({"status": "failed", "failure": "a handler hangs", "duration_s": 600.0}, "failed after 10 min: a handler"),
    ],
)
def test_how_it_ended_comes_first(result: RunResult, changes: dict[str, object], said: str) -> None:
    assert said in outcome(made(result, **changes))[0]
    assert said in printed(made(result, **changes)).splitlines()[0]


def test_what_makes_a_run_special_is_remarked(result: RunResult) -> None:
    special = made(result, deterministic=False, nondeterminism="a worker was killed", failed_robots={2: "it raised"},
                   missed_ticks=4, no_certified_motion=1, paths_replaced=2)  # fmt: skip
    text = printed(special, 300)
    for expected in ("Another run of this seed may differ: a worker was killed", "Robot 2 lost its AC: it raised"):
        assert expected in text
    shown = values(special)
    assert "ticks late by" not in shown
    assert shown["missed ticks"][0] == "4"
    assert shown["no certified motion"][0] == "1 tick"
    assert shown["plans replaced"][0] == "2 by certified ways"


def test_a_controllers_run_says_nothing_of_targets_which_it_has_none_of(result: RunResult) -> None:
    names = {"targets reached", "given up", "longest stall", "no progress for"}
    assert names <= values(result).keys()
    driven = made(result, ac="/home/me/orbit.py:Orbit")
    assert not names & values(driven).keys()
    assert "longest without AC" in values(driven)
    assert "; AC orbit.py:Orbit; " in headline(driven)


def test_the_summary_names_all_it_takes_to_run_it_again(result: RunResult) -> None:
    assert headline(result) == (
        "2 robots for 60 s on kinematic; planner straight-line, grid targets; "
        "modules: collision, obstacle, geofence, battery; seed 1"
    )
    assert "on pybullet, engine kinematic; " in headline(made(result, backend="pybullet"))
    assert "; no safety modules; seed 1" in headline(made(result, modules=()))
    text = printed(result)
    assert text.startswith("surveillance.toml: completed\n")
    assert f"trace {result.trace_sha256}\n" in text


def test_the_summary_in_a_file_has_no_control_characters(result: RunResult) -> None:
    text = printed(result)
    assert all(character == "\n" or character.isprintable() for character in text)


def test_the_caption_of_the_picture(result: RunResult) -> None:
    shown = caption(made(result, engine="kinematic", disengagements_total=1, violations={"battery": 1, "geofence": 1}),
                    0.85)  # fmt: skip
    assert shown.title == "surveillance: 2 robots, 60 s on the kinematic engine"
    assert shown.figures[1:] == ("1 disengagement", "2 violations")
    assert shown.alarming
    assert [rule.broken for rule in shown.rules] == [True, True]
    assert shown.safer_charge == 0.85
    assert caption(made(result, modules=("geofence",)), 0.85).safer_charge is None
    assert caption(made(result, engine=None, backend="zenoh", status="interrupted"), 0.85).title == (
        "surveillance: 2 robots, 60 s on zenoh (interrupted)"
    )


def test_an_adversary_is_named_in_place_of_the_mission(result: RunResult) -> None:
    attacked = made(result, ac="adversary:chase")
    assert "AC adversary:chase; modules: collision" in headline(attacked)
    assert "planner" not in headline(attacked)
    assert "AC adversary:chase instead of the mission" in differences(attacked)
    assert caption(attacked, 0.85).details == f"AC adversary:chase, seed {result.seed}"


BREACH = BreachFigures(
    times=61_000, first_s=12.25, cause="'battery': margin -0.001", last_s=700.0,
    worst=(WorstFigures(excess=0.0448, unit="of a charge", time_s=403.15, cause="'battery': margin -0.045"),
           WorstFigures(excess=0.031, unit="m", time_s=99.0, cause="'geofence': margin -0.031")),
)  # fmt: skip
ONCE = BreachFigures(
    times=1, first_s=3.0, cause="sample is 0.150 s old, declared at most 0.100 s", last_s=3.0,
    worst=(WorstFigures(excess=0.05, unit="s", time_s=3.0, cause="sample is 0.150 s old, declared at most 0.100 s"),),
)  # fmt: skip
TROUBLES: dict[str, object] = {
    "assumptions": {
        2: {"A14": BREACH},
        1: {"A14": BREACH, "A4": ONCE, "A12": BreachFigures(times=2, first_s=1.0, cause="the robot reports AC")},
    },
    "permanent_stalls": {2: StallFigures(since_s=300.0, lasted_s=6900.0, module="obstacle", cause="margin 0.02 m")},
    "never_moved": (1, 3),
    "accepted_unproved": ("P2b of module 'battery' is PARTLY: 812 s of 700 s",),
}  # fmt: skip


def test_every_assumption_that_failed_is_named_with_robot_number_and_the_worst_of_it(result: RunResult) -> None:
    shown = values(made(result, **TROUBLES))
    assert shown["assumptions failed"][0] == "4"
    assert [name for name in shown if name.startswith("A") and "robot" in name] == [
        "A4, robot 1", "A12, robot 1", "A14, robot 1", "A14, robot 2",
    ]  # fmt: skip
    assert shown["A14, robot 2"][0] == (
        "61000 times, first at 12.25 s: 'battery': margin -0.001; worst, by 4.48 % of a charge, at 403.15 s: "
        "'battery': margin -0.045; worst, by 0.031 m, at 99.00 s: 'geofence': margin -0.031"
    )
    assert shown["A4, robot 1"][0] == "once, at 3.00 s: sample is 0.150 s old, declared at most 0.100 s, by 0.05 s"
    assert shown["stalled, robot 2"][0] == "1.92 h up to the end, by obstacle: margin 0.02 m"
    assert shown["never moved"][0] == "robot 1, 3"
    assert shown["not proved"][0] == "accepted: P2b of module 'battery' is PARTLY: 812 s of 700 s"
    assert values(result)["assumptions failed"][0] == "none was seen to"


def test_what_went_wrong_fits_into_80_columns(result: RunResult) -> None:
    text = printed(made(result, **TROUBLES))
    table = text[text.index("─") :]
    assert max(map(len, table[: table.index("AC in control")].splitlines())) <= 80
    assert "61000 times" in text


def test_troubles_are_what_strict_names(result: RunResult) -> None:
    assert result.troubles == []
    assert made(result, **TROUBLES).troubles == [
        "assumption A14 failed for robot 2 (61000 times, first after 12.25 s)",
        "assumption A14 failed for robot 1 (61000 times, first after 12.25 s)",
        "assumption A4 failed for robot 1 (once, first after 3 s)",
        "assumption A12 failed for robot 1 (2 times, first after 1 s)",
        "robot 2 stalled for good after 300 s, with the safe controller of 'obstacle'",
        "robot 1 never moved",
        "robot 3 never moved",
    ]

"""What a mission file may say of what robots promise, for all and for one."""

from __future__ import annotations

import pytest

from soter.config import make_mission, parse_mission
from soter.errors import ConfigError


def promised(text: str, **overrides: object) -> tuple[int | None, dict[int, dict[str, object]]]:
    given = {name.replace("__", "."): value for name, value in overrides.items()}
    mission = parse_mission(f'workspace = "room.xml"\n{text}'.encode(), "m.toml", given)
    again = make_mission(mission.model_dump(mode="json", exclude_none=True), "recorded")
    assert again.robots == mission.robots
    robots = mission.robots
    return robots.count, {robot_id: each.given for robot_id, each in robots.promises.items()}


def test_robots_are_a_number_or_a_table_of_which_each_may_promise_something() -> None:
    assert promised("") == (None, {})
    assert promised("robots = 2") == promised("[robots]\ncount = 2") == (2, {})
    assert promised("[robots.2]\nv_max_m_s = 1\nreverses = false") == (None, {2: {"v_max_m_s": 1.0, "reverses": False}})


def test_a_number_from_the_command_line_leaves_what_the_file_says_of_single_robots() -> None:
    assert promised("[robots.2]\nlease_s = 0.3", robots=1) == (1, {2: {"lease_s": 0.3}})
    assert promised("robots = 2", robots=1) == (1, {})
    assert promised("", robots__3__v_max_m_s=0.5) == (None, {3: {"v_max_m_s": 0.5}})


@pytest.mark.parametrize(
    ("text", "line", "key", "says"),
    [
        ("robots = 300", 2, "robots", "it is 300, allowed: at most 254"),
        ("[robots.2]\nv_max_m_s = -3", 3, "robots.2.v_max_m_s", "it is -3, allowed: at least 0.01"),
        ("[robots.2]\nbrake_m_s2 = inf", 3, "robots.2.brake_m_s2", "it is inf, allowed: "),
        ("[robots.2]\nv_max = 3", 3, "robots.2.v_max", "did you mean 'v_max_m_s'"),
        ("[robots.far]\nv_max_m_s = 3", 2, "robots.far", "allowed: count, or the id of a robot"),
        ("[robots]\n2 = 3", 3, "robots.2", "allowed: a table"),
    ],
)
def test_what_is_not_allowed_is_named_with_its_place(text: str, line: int, key: str, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        promised(text)
    assert (caught.value.line, caught.value.key) == (line, key)
    assert says in str(caught.value)

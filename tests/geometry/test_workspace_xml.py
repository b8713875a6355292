"""Workspace files: what is read, and each way in which one can be wrong."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from soter.errors import ConfigError
from soter.geometry.draft import Spot
from soter.geometry.reading import read_workspace as read_any_workspace
from soter.geometry.workspace import Box, RobotPlace
from soter.geometry.workspace_xml import parse_workspace, read_workspace

DIMENSION = '<dimension x="5" y="5" z="1"/>'
ROBOTS = (
    '<robots>\n<robot id="1"><start x="1" y="1" z="0"/></robot>\n'
    '<robot id="2"><start x="2.5" y="2" z="0"/></robot>\n</robots>'
)
OBSTACLES = '<obstacles>\n<box><low x="1" y="2" z="0"/><high x="1.9" y="3" z="1"/></box>\n</obstacles>'
CHARGERS = (
    '<charging_stations>\n<box><low x="0.8" y="0.8" z="0"/><high x="1.2" y="1.2" z="0"/></box>\n'
    '<box><low x="2.3" y="1.8" z="0"/><high x="2.7" y="2.2" z="0"/></box>\n</charging_stations>'
)


def xml(dimension: str = DIMENSION, robots: str = ROBOTS, obstacles: str = OBSTACLES, chargers: str = CHARGERS) -> str:
    """A workspace file: the dimension in line 2, robots from 4, the box in 8, chargers from 11."""
    return f"<configuration>\n{dimension}\n{robots}\n{obstacles}\n{chargers}\n</configuration>\n"


def error(text: str | bytes) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_workspace(text.encode() if isinstance(text, str) else text, "room.xml")
    return str(caught.value)


def test_a_workspace_is_read() -> None:
    workspace = parse_workspace(xml().encode(), "room.xml")
    assert (workspace.width_m, workspace.depth_m) == (5.0, 5.0)
    assert workspace.boxes == (Box(1.0, 2.0, 1.9, 3.0, 1.0),)
    assert workspace.robots == (
        RobotPlace(1, 1.0, 1.0, Box(0.8, 0.8, 1.2, 1.2, 0.0)),
        RobotPlace(2, 2.5, 2.0, Box(2.3, 1.8, 2.7, 2.2, 0.0)),
    )


def test_what_may_be_left_out() -> None:
    text = xml(robots='<robots><robot id="7"><start x="1" y="1" heading="4.0"/></robot></robots>', obstacles="")
    workspace = parse_workspace(text.encode(), "room.xml")
    assert workspace.boxes == ()
    assert [place.id for place in workspace.robots] == [7]
    assert workspace.robots[0].heading_rad == pytest.approx(4.0 - 6.283185307)


def test_spare_chargers_stay_unused_and_the_others_go_by_order() -> None:
    text = xml(robots='<robots><robot id="2"><start x="2.5" y="2" z="0"/></robot></robots>')
    assert parse_workspace(text.encode(), "room.xml").robots[0].charger.centre == pytest.approx((1.0, 1.0))


def drawn_flat(*, robot_2: str = '<start x="3.25" y="2" z="0"/>', points: tuple[str, ...] = ("1 1", "3.25 2")) -> str:
    """A room without height, and stations without area, as the first files of this format had them."""
    stations = "".join(
        f'<box>\n<low x="{x}" y="{y}" z="0"/>\n<high x="{x}" y="{y}" z="0"/>\n</box>\n'
        for x, y in (point.split() for point in points)
    )
    return xml(
        dimension='<dimension x="6" y="4" z="0"/>',
        robots='<robots>\n<robot id="1"><start x="1" y="1" z="0"/></robot>\n'
        f'<robot id="2">{robot_2}</robot>\n</robots>',
        obstacles='<obstacles>\n<box><low x="2" y="1.5" z="0"/><high x="2.9" y="2.5" z="1"/></box>\n</obstacles>',
        chargers=f"<charging_stations>\n{stations}</charging_stations>",
    )


def test_a_room_drawn_flat_with_points_for_stations_is_read() -> None:
    workspace = parse_workspace(drawn_flat().encode(), "room.xml")
    assert (workspace.width_m, workspace.depth_m) == (6.0, 4.0)
    assert workspace.boxes == (Box(2.0, 1.5, 2.9, 2.5, 1.0),)
    assert [place.charger for place in workspace.robots] == [
        Box(0.75, 0.75, 1.25, 1.25, 0.0),
        Box(3.0, 1.75, 3.5, 2.25, 0.0),
    ]


def test_a_room_drawn_flat_is_refused_for_a_body_in_a_box_alone() -> None:
    inside = "the body (radius 0.105 m) would overlap a box by 0.005 m, at (3, 2); allowed: at least 0.15 m; "
    text = drawn_flat(robot_2='<start x="3" y="2" z="0"/>', points=("1 1", "3 2"))
    assert error(text).splitlines() == [
        "room.xml: 2 things are wrong",
        f"  room.xml:5: start of robot 2: {inside}the nearest free pose is (3.16, 2)",
        f"  room.xml:15: charging station of robot 2: {inside}the nearest free pose is (3.16, 2)",
    ]


def test_a_room_without_stations_points_at_those_of_the_mission_file(tmp_path: Path) -> None:
    text = drawn_flat(points=())
    assert error(text) == (
        "room.xml:10: charging_stations: 0 charging stations for 2 robots; each robot needs one, in the order of the "
        "robots; the mission file may give them, [[station]]"
    )
    path = tmp_path / "room.xml"
    path.write_text(text.replace("<charging_stations>\n</charging_stations>", ""))
    stations = [Spot("station 1", 1.0, 2.0), Spot("station 2", 4.5, 2.0)]
    made = read_any_workspace(path, stations=stations)
    assert made.bounds == (0.0, 0.0, 6.0, 4.0)
    assert [(each.id, each.x_m, each.charger.centre) for each in made.robots] == [
        (1, 1.0, (1.0, 2.0)),
        (2, 3.25, (4.5, 2.0)),
    ]
    with pytest.raises(ConfigError, match=r"start: .*room\.xml says itself where they are"):
        read_any_workspace(path, stations=stations, starts=stations)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_encodings(encoding: str) -> None:
    head = f'<?xml version="1.0" encoding="{encoding.removesuffix("-sig")}"?>\n<!-- dépôt -->\n'
    assert parse_workspace((head + xml()).encode(encoding), "room.xml").width_m == 5.0


START_1 = '<start x="1" y="1" z="0"/>'
BOX = '<low x="1" y="2" z="0"/><high x="1.9" y="3" z="1"/>'

WRONG: dict[str, tuple[str, list[str]]] = {
    # no XML, or not ours
    "empty": ("", ["room.xml:1: not well-formed XML: no element found (column 0)"]),
    "not xml": ("duration_s = 600\n", ["room.xml:1: not well-formed XML: syntax error (column 0)"]),
    "cut off": (xml().rpartition("</charging")[0], ["room.xml:13: ", "not well-formed XML: no element found"]),
    "tags crossed": (xml().replace("</robots>", "</robot>"), ["room.xml:6: not well-formed XML: mismatched tag"]),
    "attribute twice": (
        xml(dimension='<dimension x="5" x="6" y="5" z="1"/>'),
        ["room.xml:2: not well-formed XML: duplicate attribute"],
    ),
    "wrong root": ("<workspace/>", ["room.xml:1: <workspace>: the outermost element must be <configuration>"]),
    "too deep": ("<configuration>" + "<robots>" * 9, ["room.xml:1: elements are nested more than 8 deep"]),
    "unknown encoding": ('<?xml version="1.0" encoding="klingon"?><configuration/>', ["room.xml", "encoding"]),
    # what defusedxml is for
    "entity": (
        '<!DOCTYPE x [<!ENTITY a "5">]>\n' + xml(dimension='<dimension x="&a;" y="5" z="1"/>'),
        ["room.xml:1: a document type or an entity is declared, which is refused for safety; remove the <!DOCTYPE"],
    ),
    "external entity": (
        '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>\n' + xml(),
        ["a document type or an entity is declared"],
    ),
    "dtd": ('<!DOCTYPE configuration SYSTEM "http://localhost/x.dtd">\n' + xml(), ["a document type"]),
    "undeclared entity": (xml(dimension='<dimension x="&a;" y="5" z="1"/>'), ["room.xml:2: not well-formed XML"]),
    # elements and attributes
    "unknown element": (
        xml().replace("obstacles>", "obstacels>"),
        [
            (
                "room.xml:7: <configuration>: unknown element <obstacels>, did you mean 'obstacles'?; allowed here: "
                "<dimension>, <robots>, <obstacles>, <charging_stations>"
            )
        ],
    ),
    "element where none belongs": (
        xml(dimension='<dimension x="5" y="5" z="1"><x/></dimension>'),
        ["room.xml:2: <dimension>: unknown element <x>; allowed here: none"],
    ),
    "unknown attribute": (
        xml().replace(START_1, '<start x="1" y="1" z="0" haeding="1"/>'),
        ["room.xml:4: <start>: unknown attribute 'haeding', did you mean 'heading'?; allowed: x, y, z, heading"],
    ),
    "attribute where none belongs": (
        xml().replace("<robots>", '<robots n="2">'),
        ["room.xml:3: <robots>: unknown attribute 'n'; allowed: none"],
    ),
    "missing attribute": (
        xml(dimension='<dimension x="5" z="1"/>'),
        ["room.xml:2: <dimension>: attribute 'y' is missing; it needs x, y, z"],
    ),
    "text": (
        xml().replace(START_1, "1 1 0"),
        ["room.xml:4: <robot>: text '1 1 0' is not allowed here; values stand in attributes"],
    ),
    "no dimension": (xml(dimension=""), ["room.xml:1: <configuration>: <dimension> is missing"]),
    "no robots": (xml(robots=""), ["room.xml:1: <configuration>: <robots> is missing"]),
    "no chargers": (
        xml(chargers=""),
        ["room.xml:1: charging_stations: 0 charging stations for 2 robots; each robot needs one"],
    ),
    "two dimensions": (
        xml(dimension=DIMENSION + "\n" + DIMENSION),
        ["room.xml:3: <dimension>: it occurs 2 times, allowed: once"],
    ),
    "no start": (xml().replace(START_1, ""), ["room.xml:4: <robot>: it has 0 <start>, allowed: exactly one"]),
    "two starts": (xml().replace(START_1, 2 * START_1), ["room.xml:4: <robot>: it has 2 <start>, allowed: exactly"]),
    "half a box": (
        xml().replace('<low x="1" y="2" z="0"/>', ""),
        ["room.xml:8: <box>: it has 0 <low>, allowed: exactly one"],
    ),
    # numbers
    **{
        f"number {text}": (
            xml(dimension=f'<dimension x="{text}" y="5" z="1"/>'),
            [f"room.xml:2: <dimension>: x is '{text}', allowed: a finite decimal number, at most +-10000"],
        )
        for text in ("nan", "inf", "-inf", "1e999", "1e5", "", "five", "1_0", "0x10", "5,0", "٥")
    },
    "zero size": (
        xml(dimension='<dimension x="5" y="0" z="1"/>'),
        ["room.xml:2: <dimension>: y is 0, allowed: above 0"],
    ),
    "negative size": (
        xml(dimension='<dimension x="-5" y="5" z="1"/>'),
        ["room.xml:2: <dimension>: x is -5, allowed: above 0"],
    ),
    "negative height": (
        xml(dimension='<dimension x="5" y="5" z="-1"/>'),
        ["room.xml:2: <dimension>: z is -1, allowed: at least 0"],
    ),
    "start nan": (
        xml().replace(START_1, '<start x="nan" y="1" z="0"/>'),
        ["room.xml:4: robot 1: x is 'nan', allowed: a finite"],
    ),
    "heading inf": (
        xml().replace(START_1, '<start x="1" y="1" z="0" heading="inf"/>'),
        ["room.xml:4: robot 1: heading is 'inf'"],
    ),
    # robots
    "no robot": (
        xml(robots="<robots/>"),
        ["room.xml:3: <robots>: there is no robot, allowed: at least one <robot>"],
    ),
    "missing id": (
        xml().replace('<robot id="2">', "<robot>"),
        ["room.xml:5: <robot>: attribute 'id' is missing; it needs id"],
    ),
    "duplicate id": (
        xml().replace('id="2"', 'id="1"'),
        ["room.xml:5: robot 1: this id is taken by the robot in line 4; each robot needs its own"],
    ),
    **{
        f"id {text}": (
            xml().replace('id="2"', f'id="{text}"'),
            [f"room.xml:5: <robot>: id is '{text}', allowed: a whole number from 1 to 254"],
        )
        for text in ("0", "-1", "255", "1.0", "two", "", "01", "1e2", "9999999999")
    },
    "start outside": (
        xml().replace(START_1, '<start x="5.5" y="1" z="0"/>'),
        ["room.xml:4: robot 1: it starts outside the workspace, at (5.5, 1, 0); allowed: from (0, 0, 0) to (5, 5, 1)"],
    ),
    "start in the air": (
        xml().replace(START_1, '<start x="1" y="1" z="2"/>'),
        ["robot 1: it starts outside the workspace, at (1, 1, 2)"],
    ),
    "start in a box": (
        xml().replace(START_1, '<start x="1.5" y="2.9" z="0"/>'),
        [
            (
                "room.xml:4: start of robot 1: it lies in a box, at (1.5, 2.9); allowed: at least 0.15 "
                "m; the nearest free "
                "pose is (1.5, 3.26)"
            )
        ],
    ),
    "body in a box": (
        xml().replace('<start x="2.5" y="2" z="0"/>', '<start x="2" y="2.5" z="0"/>'),
        [
            (
                "room.xml:5: start of robot 2: the body (radius 0.105 m) would overlap a box by 0.005 m, at (2, 2.5); "
                "allowed: at least 0.15 m; the nearest free pose is (2.16, 2.5)"
            )
        ],
    ),
    "too little clearance": (
        xml().replace('<start x="2.5" y="2" z="0"/>', '<start x="2.15" y="2.5" z="0"/>'),
        [
            (
                "room.xml:5: start of robot 2: the body (radius 0.105 m) would be only 0.145 m from a "
                "box, at (2.15, 2.5); "
                "allowed: at least 0.15 m; the nearest free pose is (2.16, 2.5)"
            )
        ],
    ),
    "charger with too little clearance": (
        xml().replace('<low x="2.3" y="1.8"', '<low x="1.8" y="1.6"').replace('<high x="2.7"', '<high x="2.2"'),
        ["room.xml:12: charging station of robot 2: the body (radius 0.105 m) would be only", "nearest free pose is"],
    ),
    "nowhere to stand": (
        xml(
            dimension='<dimension x="0.6" y="0.6" z="1"/>',
            robots='<robots><robot id="1"><start x="0.1" y="0.1"/></robot></robots>',
            obstacles='<obstacles><box><low x="0.15" y="0.15" z="0"/><high x="0.45" y="0.45" z="1"/></box></obstacles>',
            chargers='<charging_stations><box><low x="0" y="0" z="0"/><high x="0.2" y="0.2" z="0"/></box>'
            "</charging_stations>",
        ),
        ["start of robot 1: ", "charging station of robot 1: ", "there is no free pose", "2 things are wrong"],
    ),
    "starts too close": (
        xml().replace('<start x="2.5" y="2" z="0"/>', '<start x="1.4" y="1" z="0"/>'),
        ["room.xml:5: start of robot 2: it is 0.400 m from the start of robot 1, allowed: at least 0.5 m between"],
    ),
    "chargers too close": (
        xml()
        .replace('<low x="2.3" y="1.8" z="0"/>', '<low x="1" y="1" z="0"/>')
        .replace('<high x="2.7" y="2.2"', '<high x="1.2" y="1.2"'),
        ["room.xml:12: charging station of robot 2: it is 0.141 m from the charging station of robot 1, allowed: at"],
    ),
    "too few chargers": (
        xml(
            chargers='<charging_stations><box><low x="0.8" y="0.8" z="0"/><high x="1.2" y="1.2" z="0"/></box>'
            "</charging_stations>"
        ),
        ["room.xml:10: charging_stations: 1 charging stations for 2 robots; each robot needs one, in the order"],
    ),
    # boxes
    "inside out": (
        xml().replace(BOX, '<low x="1.9" y="2" z="0"/><high x="1" y="3" z="1"/>'),
        ["room.xml:8: obstacle 1: it is inside out: high x is 1, allowed: above low x, which is 1.9"],
    ),
    "flat box": (
        xml().replace(BOX, '<low x="1" y="2" z="0"/><high x="1.9" y="3" z="0"/>'),
        ["room.xml:8: obstacle 1: it is inside out: high z is 0, allowed: above low z, which is 0"],
    ),
    "charger inside out": (
        xml().replace('<high x="1.2" y="1.2"', '<high x="1.2" y="0.7"'),
        ["room.xml:11: charging station 1: it is inside out: high y is 0.7, allowed: above low y, which is 0.8"],
    ),
    "charger that is a line": (
        xml().replace('<high x="1.2" y="1.2"', '<high x="0.8" y="1.2"'),
        ["room.xml:11: charging station 1: it is inside out: high x is 0.8, allowed: above low x, which is 0.8"],
    ),
    "charger that is a point outside": (
        xml().replace('<low x="0.8" y="0.8"', '<low x="6" y="1"').replace('<high x="1.2" y="1.2"', '<high x="6" y="1"'),
        ["room.xml:11: charging station 1: it lies outside the workspace: x from 6 to 6, allowed: 0 to 5"],
    ),
    "charger too small to come to rest on": (
        xml().replace('<high x="1.2" y="1.2"', '<high x="0.89" y="1.2"'),
        ["room.xml:11: charging station 1: it is 0.09 m wide in x, allowed: at least 0.1 m"],
    ),
    "floating": (
        xml().replace(BOX, '<low x="1" y="2" z="0.2"/><high x="1.9" y="3" z="1"/>'),
        ["room.xml:8: obstacle 1: low z is 0.2, allowed: 0, it stands on the ground"],
    ),
    "box outside": (
        xml().replace(BOX, '<low x="4.5" y="2" z="0"/><high x="5.5" y="3" z="1"/>'),
        ["room.xml:8: obstacle 1: it lies outside the workspace: x from 4.5 to 5.5, allowed: 0 to 5"],
    ),
    "charger outside": (
        xml().replace('<low x="0.8" y="0.8"', '<low x="-0.8" y="0.8"'),
        ["room.xml:11: charging station 1: it lies outside the workspace: x from -0.8 to 1.2, allowed: 0 to 5"],
    ),
    "too many boxes": (
        xml().replace(f"<box>{BOX}</box>", 251 * f"<box>{BOX}</box>"),
        ["room.xml:7: <obstacles>: 251 boxes, allowed: at most 250"],
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_named(case: str) -> None:
    text, parts = WRONG[case]
    message = error(text)
    for part in parts:
        assert part in message


def test_all_that_is_wrong_is_listed_in_the_order_of_the_file() -> None:
    message = error(xml().replace('id="2"', 'id="0"').replace(START_1, '<start x="9" y="1" z="0"/>'))
    assert message.splitlines() == [
        "room.xml: 2 things are wrong",
        "  room.xml:4: robot 1: it starts outside the workspace, at (9, 1, 0); allowed: from (0, 0, 0) to (5, 5, 1)",
        "  room.xml:5: <robot>: id is '0', allowed: a whole number from 1 to 254",
    ]


def test_a_long_list_is_cut() -> None:
    message = error(xml(robots="<robots>" + 30 * '<robot id="0"><start x="1" y="1"/></robot>' + "</robots>"))
    assert message.startswith("room.xml: 30 things are wrong\n")
    assert message.endswith("\n  and 10 more")


def test_a_single_problem_has_attributes() -> None:
    with pytest.raises(ConfigError) as caught:
        parse_workspace(xml().replace('id="2"', 'id="0"').encode(), "room.xml")
    assert (caught.value.source, caught.value.line, caught.value.key) == ("room.xml", 5, "<robot>")


def test_the_named_pose_is_free() -> None:
    text = xml().replace(START_1, '<start x="2.01" y="3.03" z="0"/>')
    pose = error(text).rpartition("pose is (")[2].rstrip(")").split(", ")
    fixed = text.replace('<start x="2.01" y="3.03"', f'<start x="{pose[0]}" y="{pose[1]}"')
    assert parse_workspace(fixed.encode(), "room.xml").robots[0].x_m == float(pose[0])


def test_exactly_the_needed_clearance_is_enough() -> None:
    # 1.9 + 0.105 + 0.15 is not 2.155 in binary.
    text = xml().replace('<start x="2.5" y="2" z="0"/>', '<start x="2.155" y="2.5" z="0"/>')
    assert parse_workspace(text.encode(), "room.xml").robots[1].x_m == 2.155


def test_clearance_and_spacing_follow_the_modules() -> None:
    data = xml().encode()
    with pytest.raises(ConfigError, match=r"robot 2: the body .* allowed: at least 0\.55 m"):
        parse_workspace(data, "room.xml", phi_safer_m=0.5)
    with pytest.raises(ConfigError, match=r"robot 2: it is 1\.802 m from the start of robot 1, allowed: at least 2 m"):
        parse_workspace(data, "room.xml", spacing_m=2.0)


def test_a_missing_file_is_named_with_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "warehouse.xml").write_text(xml())
    with pytest.raises(
        ConfigError,
        match=r"warehuose\.xml: this workspace file does not exist, did you mean "
        r"'warehouse\.xml'\?",
    ):
        read_workspace(tmp_path / "warehuose.xml")


def test_a_folder_and_a_pipe_are_no_files(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.xml"
    os.mkfifo(pipe)
    with pytest.raises(ConfigError, match="this workspace file is a pipe or a device, allowed: a regular file"):
        read_workspace(pipe)
    with pytest.raises(ConfigError, match=r"it is a folder; name a workspace file$"):
        read_workspace(tmp_path)


def test_a_name_that_no_file_can_have() -> None:
    with pytest.raises(ConfigError, match="this workspace file"):
        read_workspace(Path("no\0name.xml"))


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.xml"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # sparse: a terabyte that takes no space
    with pytest.raises(ConfigError, match=r"huge\.xml: this workspace file is longer than 1000000 bytes"):
        read_workspace(path)
    with pytest.raises(ConfigError, match="longer than 1000000 bytes"):
        parse_workspace(b" " * 1_000_001, "room.xml")
